//! `kinds demo`: the whole way once, with real processes, on trips that are driven for it or given.

mod live;
mod processes;
mod report;
mod serving;
mod subject;

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::ValueEnum;
use kinds_model::{Method, Model, Size, refit};
use kinds_trainer::{Config, EvaluationPlan, Meetings, Rivals, Stage, Trained, load};
use kinds_trips::Selection;

use crate::cli::{DemoArguments, RobotName};
use crate::commands::demo::live::Course;
use crate::commands::demo::report::Visited;
use crate::commands::demo::subject::Subject;
use crate::commands::{evaluate, train};
use crate::failure::Failure;
use crate::progress::StepBar;
use crate::say::say;
use crate::{model_file, report_folder, stop, whole_file};

/// How long the second trip is to be looked at.
const SHOW_S: f64 = 12.0;

/// The paper's radius: 1 foot.
const RADIUS_M: f64 = 0.3048;

pub(crate) fn run(arguments: &DemoArguments) -> Result<(), Failure> {
    let folder = &arguments.output;
    let mut steps = Steps::default();
    let subject = subject(&arguments.subject, folder, &mut steps)?;
    let [trip1, trip2] = &subject.trips;

    let model_path = folder.join("model.kinds");
    steps.begin(&format!("train: {} → {}", trip1.display(), model_path.display()))?;
    let (model, remarks) = learn(trip1, &model_path)?;

    let course = Course::read(trip2, &subject.selection)?;
    let speed = (course.duration_s / SHOW_S).round().max(1.0).to_string();
    steps.begin(&format!(
        "serve, publish, watch: {} at {speed} times the recorded pace, as three processes",
        trip2.display()
    ))?;
    let stop = stop::on_signals()?;
    let reports = serving::serve_and_watch(&model_path, &course, &speed, &subject, &stop)?;
    stop::from_now_on_at_once(&stop);
    say(format!("   {}", serving::statistics(&reports)))?;
    write_file(folder, "kinds.csv", &serving::table(&reports))?;

    steps.begin(
        "compare: how many dimensions and kinds do the frames ask for, by Isomap and by principal components?",
    )?;
    let pca = refit_with_own_size(&model)?;
    model_file::write(&folder.join("pca.kinds"), &pca)?;
    say_table_1([&model, &pca])?;

    let rivals = rivals(model)?;
    let visit = |place: &str, trips: &[PathBuf; 2]| visit(place, trips, &subject.selection, &rivals);
    steps.begin(&format!("evaluate {}: do places that both trips saw get the same kind?", subject.home))?;
    let home = visit(&subject.home, &subject.trips)?;
    say_evaluation(&home, folder, "evaluation.json")?;
    let mut elsewhere = None;
    if let Some((place, trips)) = &subject.elsewhere {
        steps.begin(&format!(
            "evaluate {place}: do the kinds of {} hold where they were not learnt?",
            subject.home
        ))?;
        let visited = visit(place, trips)?;
        say_evaluation(&visited, folder, "evaluation-elsewhere.json")?;
        say(format!("   {}", visited.runs()))?;
        elsewhere = Some(visited);
    }

    let page = report::page([&rivals.isomap, &pca], &remarks, &home, elsewhere.as_ref());
    let report = report_folder::write(&folder.join("report"), &page)?;
    steps.begin(&format!("report: open {}", report.display()))?;
    say(format!(
        "   in {} are also the trips, both models, a line for each report in kinds.csv, and the evaluations as JSON",
        folder.display()
    ))
}

/// What is asked for: two trips that are there, or those of a robot, which is driven for them.
fn subject(asked: &[PathBuf], folder: &Path, steps: &mut Steps) -> Result<Subject, Failure> {
    let robot = match asked {
        [trip1, trip2] => {
            let subject = Subject::recorded([trip1.clone(), trip2.clone()])?;
            make_folder(folder)?;
            return Ok(subject);
        }
        [name] => name.to_str().and_then(|name| RobotName::from_str(name, false).ok()),
        _ => None,
    };
    let Some(robot) = robot else {
        let asked: Vec<_> = asked.iter().map(|path| path.display().to_string()).collect();
        return Err(Failure::AskedWrongly(format!(
            "a demo is shown on crunch, on chew, or on two recorded trips; it was asked for on \"{}\"",
            asked.join(" ")
        )));
    };
    make_folder(folder)?;
    let subject = Subject::simulated(robot, folder);
    steps.begin(&format!("drive: {} → {}", journey(robot), folder.display()))?;
    let start = Instant::now();
    let driven = subject.drive(robot)?;
    say(format!(
        "   {} frames of {} readings: {:.1} min of driving in {:.1} s",
        driven.n_frames,
        driven.n_readings,
        driven.duration_s / 60.0,
        start.elapsed().as_secs_f64()
    ))?;
    Ok(subject)
}

fn make_folder(folder: &Path) -> Result<(), Failure> {
    std::fs::create_dir_all(folder).map_err(|error| Failure::file("make folder", folder, &error))
}

fn journey(robot: RobotName) -> &'static str {
    match robot {
        RobotName::Crunch => "Crunch, with 16 sonars and infrared sensors, twice over each of two floors",
        RobotName::Chew => "Chew, with a camera of 160 × 124 pixels, twice across a campus",
    }
}

/// Learns the kinds of a trip. Returns the model, and sentences on how it came about.
fn learn(trip: &Path, model_path: &Path) -> Result<(Model, Vec<String>), Failure> {
    model_file::check_writable(model_path)?;
    let Trained { model, remarks, .. } = train::train(&[trip.to_path_buf()], &Config::default())?;
    model_file::write(model_path, &model)?;
    say(format!("   {}", train::summary(&model)))?;
    let remarks: Vec<String> = train::choices(&model).into_iter().chain(remarks).collect();
    for line in &remarks {
        say(format!("   {line}"))?;
    }
    Ok((model, remarks))
}

/// What principal components make of the same frames, with as many dimensions and kinds as speak for themselves.
fn refit_with_own_size(model: &Model) -> Result<Model, Failure> {
    let mut bar = StepBar::new();
    let refitted = refit(model, Method::Pca, Size::Own, &mut |step, done, all| {
        bar.show(Stage::Fitting(step), done as u64, all as u64);
    });
    refitted.map_err(|error| {
        Failure::CouldNot(format!("cannot fit principal components for comparison: {error}"))
    })
}

/// The paper's Table 1.
fn say_table_1(own: [&Model; 2]) -> Result<(), Failure> {
    say("   Table 1  readings  dims  kinds")?;
    for (name, model) in ["Isomap", "PCA"].into_iter().zip(own) {
        let (n_dims, n_kinds) = (model.manifest().n_dims, model.mixture().n_kinds());
        say(format!("   {name:7} {:9} {n_dims:5} {n_kinds:6}", model.layout().n_readings()))?;
    }
    Ok(())
}

fn rivals(model: Model) -> Result<Rivals, Failure> {
    let mut bar = StepBar::new();
    Ok(Rivals::of(model, &mut |stage: Stage, done, all| bar.show(stage, done, all))?)
}

fn visit(
    place: &str,
    trips: &[PathBuf; 2],
    selection: &Selection,
    rivals: &Rivals,
) -> Result<Visited, Failure> {
    let mut bar = StepBar::new();
    let mut show = |stage: Stage, done, all| bar.show(stage, done, all);
    let [first, second] = trips;
    let trips = [load(first, selection, &mut show)?, load(second, selection, &mut show)?];
    let plan = EvaluationPlan { radius_m: RADIUS_M, ..EvaluationPlan::default() };
    let meetings = Meetings::find(rivals.isomap.layout(), &[&trips], &plan.same_place())?;
    let evaluation = kinds_trainer::evaluate(rivals, &meetings, &plan, &mut show)?;
    Ok(Visited { place: place.to_string(), evaluation })
}

fn say_evaluation(visited: &Visited, folder: &Path, name: &str) -> Result<(), Failure> {
    let scores = &visited.pair().forward.scores;
    say(format!("   {}", evaluate::headline(scores)))?;
    for line in evaluate::table(scores) {
        say(format!("   {line}"))?;
    }
    let json = serde_json::to_vec_pretty(&visited.evaluation).expect("an evaluation is plain data");
    write_file(folder, name, &json).map(drop)
}

fn write_file(folder: &Path, name: &str, bytes: &[u8]) -> Result<PathBuf, Failure> {
    let path = folder.join(name);
    whole_file::write(&path, bytes).map_err(|error| Failure::file("write", &path, &error))?;
    Ok(path)
}

/// The steps of the demo, a line each.
#[derive(Default)]
struct Steps(usize);

impl Steps {
    fn begin(&mut self, what: &str) -> Result<(), Failure> {
        self.0 += 1;
        say(format!("{}. {what}", self.0))
    }
}
