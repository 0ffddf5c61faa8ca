//! `kinds evaluate`: is a place seen again of the same kind?

mod report;

use std::path::{Path, PathBuf};

use kinds_model::{Model, Register};
use kinds_trainer::{
    ClassifiedTrip, CommandSpread, Evaluation, LoadedTrip, Meetings, MethodScores, PairScores, Policy,
    Rivals, Scores, SegmentFormat, Segmentation, SegmentationAgreement, Stage, Track, TripKinds, Uses,
    evaluate_single, load,
};
use kinds_trips::{Role, Selection};
use serde::Serialize;

use crate::cli::EvaluateArguments;
use crate::failure::Failure;
use crate::progress::StepBar;
use crate::say::{mention, say};
use crate::{log, model_file, report_folder, whole_file};

/// What `evaluate --json` prints.
#[derive(Serialize)]
struct Output<'a> {
    #[serde(flatten)]
    evaluation: &'a Evaluation,
    spaces: &'a [Uses],
    /// A person's segmentation beside the kinds, if one was given.
    segmentation: Option<&'a SegmentationAgreement>,
}

pub(crate) fn run(arguments: &EvaluateArguments) -> Result<(), Failure> {
    arguments.plan().check()?;
    let map_plan = arguments.map_plan()?;
    let model = model_file::open(&arguments.model)?;
    arguments.report.as_deref().map_or(Ok(()), report_folder::check_writable)?;
    arguments.policy.as_deref().map_or(Ok(()), whole_file::check_writable)?;
    let segments = arguments.segments.as_deref().map(Segments::read).transpose()?;
    let Evaluated { model, evaluation, segmentation } = evaluate(model, arguments, segments.as_ref())?;
    let n_kinds = model.mixture().n_kinds();
    let agreement = segmentation.map(|segmentation| {
        let trips: Vec<TripKinds> = evaluation.trips.iter().map(ClassifiedTrip::trip_kinds).collect();
        segmentation.compare(&trips, n_kinds)
    });
    for remark in evaluation.remarks.iter().chain(&evaluation.not_compared) {
        log::notice(remark);
    }
    let uses = Uses::of(&evaluation.trips, n_kinds, &map_plan, arguments.plan().seed);
    if let Some(path) = &arguments.policy {
        write_policy(path, &model, &uses[0].policy)?;
    }
    let report = match &arguments.report {
        Some(folder) => {
            let page = report::page(&model, &evaluation, &uses, agreement.as_ref());
            Some(report_folder::write(folder, &page)?)
        }
        None => None,
    };
    if arguments.json {
        let output = Output { evaluation: &evaluation, spaces: &uses, segmentation: agreement.as_ref() };
        return say(serde_json::to_string_pretty(&output).expect("an evaluation is plain data"));
    }
    tell(&evaluation)?;
    for (index, uses) in uses.iter().enumerate() {
        if index > 0 || !evaluation.pairs.is_empty() {
            say("")?;
        }
        tell_uses(uses, model.register())?;
    }
    agreement.iter().try_for_each(tell_agreement)?;
    let written = arguments.policy.iter().chain(&report);
    written.map(|path| format!("wrote {}", path.display())).try_for_each(mention)
}

/// A segmentation that was read and waits for the trips that it is of.
struct Segments<'a> {
    path: &'a Path,
    text: String,
    format: SegmentFormat,
}

impl<'a> Segments<'a> {
    /// Before long work.
    fn read(path: &'a Path) -> Result<Self, Failure> {
        let format = match path.extension().and_then(|extension| extension.to_str()) {
            Some("csv") => SegmentFormat::Csv,
            Some("ron") => SegmentFormat::Ron,
            _ => {
                let path = path.display();
                let what =
                    format!("segments are {path}; it must be a table, FILE.csv, or a list in RON, FILE.ron");
                return Err(Failure::AskedWrongly(what));
            }
        };
        let text = std::fs::read_to_string(path).map_err(|error| Failure::file("read", path, &error))?;
        Ok(Self { path, text, format })
    }

    fn of(&self, trips: &[LoadedTrip]) -> Result<Segmentation, Failure> {
        let tracks: Vec<Track> = trips.iter().map(|trip| Track::of(&trip.survey)).collect();
        let trips: Vec<TripKinds> = tracks.iter().map(|track| track.with_kinds(&[])).collect();
        Segmentation::parse(&self.text, self.format, &trips)
            .map_err(|error| Failure::CouldNot(format!("{}: {error}", self.path.display())))
    }
}

/// Writes the policy of the trips where the kinds are at home.
fn write_policy(path: &Path, model: &Model, policy: &Policy) -> Result<(), Failure> {
    if !policy.has_commands() {
        return Err(Failure::CouldNot(format!(
            "cannot write a policy: none of the trips ({}) has commands, messages of type {}; record what the robot is told, or name \
             their topic with --commands-topic",
            policy.trips.join(", "),
            Role::Commands.types()
        )));
    }
    let text = policy.to_ron(&model.id().to_string(), model.register());
    whole_file::write(path, text.as_bytes()).map_err(|error| Failure::file("write", path, &error))
}

/// What was found, for a person.
fn tell(evaluation: &Evaluation) -> Result<(), Failure> {
    for (index, pair) in evaluation.pairs.iter().enumerate() {
        if evaluation.trips.len() > 2 {
            let blank = if index == 0 { "" } else { "\n" };
            say(format!("{blank}{} revisited by {}", pair.trips[0], pair.trips[1]))?;
        }
        say(format!("{}\n", headline(&pair.forward.scores)))?;
        table(&pair.forward.scores).into_iter().try_for_each(say)?;
        say(backward(pair))?;
    }
    Ok(())
}

/// What the kinds of one space make, for a person: a few lines of what a report shows whole.
fn tell_uses(uses: &Uses, register: &Register) -> Result<(), Failure> {
    for sequence in &uses.sequences {
        let per_m = sequence.switches_per_m.map_or(String::new(), |rate| format!(", {rate:.2} a metre"));
        let per_s =
            sequence.switches_per_s.map_or(String::new(), |rate| format!(" ({rate:.2} a second{per_m})"));
        say(format!(
            "{}: the kind changed {} times{per_s}; one lasts {:.1} s in the mean, {:.1} frames where any order would give {:.1}",
            sequence.trip,
            sequence.n_switches,
            sequence.run_s.mean,
            sequence.run_frames.mean,
            sequence.run_frames_shuffled
        ))?;
    }
    for (sequence, drift) in uses.sequences.iter().zip(&uses.drift) {
        let Some(drift) = drift else { continue };
        say(format!(
            "{}: {:.1} % of the frames are novel, where {} % is usual; kinds have other shares than in training for {:.1} % of them{}",
            sequence.trip,
            100.0 * drift.novel,
            100.0 * drift.novel_usual,
            100.0 * drift.total_variation,
            drift.half_split.zip(drift.half_split_usual).map_or(String::new(), |(error, usual)| format!(
                "; halves of a frame's neighbours place it {:.1} % apart, where {:.1} % is usual",
                100.0 * error,
                100.0 * usual
            ))
        ))?;
    }
    if let Some(map) = &uses.map {
        say(format!("map: {} regions, {} ways between them", map.regions.len(), map.edges.len()))?;
    }
    for kind in uses.policy.aliased() {
        let sorts = kind.modes.iter().map(|mode| {
            let CommandSpread { forward_m_s, turn_rad_s, .. } = mode.command;
            let share = 100.0 * mode.share;
            format!("{forward_m_s:.2} m/s turning {turn_rad_s:.2} rad/s ({share:.0} % of the frames)")
        });
        say(format!(
            "kind {} is perceptually aliased: it was driven through at {}",
            register.label(kind.kind),
            sorts.collect::<Vec<_>>().join(", or at ")
        ))?;
    }
    Ok(())
}

/// How far a person and the robot agree, for a person.
fn tell_agreement(agreement: &SegmentationAgreement) -> Result<(), Failure> {
    let SegmentationAgreement { names, n_frames_named, ami, kinds_differ, names_differ, .. } = agreement;
    say(format!(
        "\n{} names for {n_frames_named} frames: adjusted mutual information with the kinds {:.2}; in {} stretches a name has another \
         kind than usual, in {} a kind another name",
        names.len(),
        hundredths(*ami),
        kinds_differ.len(),
        names_differ.len()
    ))
}

/// What evaluating came to.
struct Evaluated {
    model: Model,
    evaluation: Evaluation,
    segmentation: Option<Segmentation>,
}

/// Evaluates with a progress bar.
fn evaluate(
    model: Model,
    arguments: &EvaluateArguments,
    segments: Option<&Segments>,
) -> Result<Evaluated, Failure> {
    let mut bar = StepBar::new();
    let selection = arguments.selection(model.layout().metres_per_count);
    let mut read = |paths: &[PathBuf]| -> Result<Vec<LoadedTrip>, Failure> {
        paths.iter().map(|path| read_trip(path, &selection, &model, &mut bar)).collect()
    };
    let mut trips = read(&arguments.trips)?;
    trips.extend(read(&arguments.elsewhere)?);
    let segmentation = segments.map(|segments| segments.of(&trips)).transpose()?;
    let spaces: [&[LoadedTrip]; 2] = trips.split_at(arguments.trips.len()).into();
    let plan = arguments.plan();
    let meetings = Meetings::find(model.layout(), &spaces, &plan.same_place())?;
    let mut show = |stage: Stage, done, all| bar.show(stage, done, all);
    if meetings.is_empty() {
        let evaluation = evaluate_single(&model, &meetings, &plan, &mut show);
        return Ok(Evaluated { model, evaluation, segmentation });
    }
    let rivals = Rivals::of(model, &mut show)?;
    let evaluation = kinds_trainer::evaluate(&rivals, &meetings, &plan, &mut show)?;
    Ok(Evaluated { model: rivals.own_model().clone(), evaluation, segmentation })
}

fn read_trip(
    path: &Path,
    selection: &Selection,
    model: &Model,
    bar: &mut StepBar,
) -> Result<LoadedTrip, Failure> {
    let trip = load(path, selection, &mut |stage, done, all| bar.show(stage, done, all))?;
    for remark in &trip.survey.remarks {
        log::notice(remark);
    }
    if model.commands().is_some() {
        trip.survey.require_commands()?;
    }
    Ok(trip)
}

/// What was measured, for a person.
pub(crate) fn headline(scores: &Scores) -> String {
    format!(
        "{:.0} % of the first trip's frames were revisited within {} m; consistent: over {:.0} % of those of the same kind",
        100.0 * scores.revisited,
        scores.radius_m,
        100.0 * scores.share,
    )
}

/// The methods side by side, for a person: a line each, and one of titles.
pub(crate) fn table(scores: &Scores) -> Vec<String> {
    let line = |(name, scores): (&str, &MethodScores)| {
        let interval = scores.confidence.map_or(String::new(), |confidence| interval(confidence.kappa));
        format!(
            "{name:6} {:>5} {:>6} {:>10.1} % {:>5.1} % {:>6.2} {interval:>14} {:>5.2} {:>11.1} %",
            scores.n_dims,
            scores.n_kinds,
            100.0 * scores.consistency,
            100.0 * scores.chance,
            hundredths(scores.kappa),
            hundredths(scores.ami),
            100.0 * scores.largest_kind_share,
        )
    };
    let titles =
        "method  dims  kinds  consistency  chance  kappa  95 % of kappa   AMI  largest kind".to_string();
    let named = scores.methods.named();
    // A word is enough beside a table.
    let short = named.into_iter().map(|(name, scores)| (name.trim_end_matches(" space"), scores));
    std::iter::once(titles).chain(short.map(line)).collect()
}

/// The model's own scores the other way round, for a person.
fn backward(pair: &PairScores) -> String {
    let Scores { revisited, methods, .. } = &pair.backward.scores;
    let named = methods.named();
    let of = |(name, scores): &(&str, &MethodScores)| format!("{name} {:.2}", hundredths(scores.kappa));
    let kappas: Vec<String> = named.iter().map(of).collect();
    format!("the other way round {:.0} % were revisited; kappa: {}", 100.0 * revisited, kappas.join(", "))
}

/// ` 0.41 …  0.58`
fn interval([low, high]: [f64; 2]) -> String {
    format!("{:.2} … {:>5.2}", hundredths(low), hundredths(high))
}

/// Rounded, without a minus before a zero.
fn hundredths(value: f64) -> f64 {
    (100.0 * value).round() / 100.0 + 0.0
}
