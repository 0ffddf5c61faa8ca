//! Reports of small made-up data, read back as a person's browser reads them: the page, and what all figures have in common.

mod called;
mod figures;
mod pages;
mod topology;

use std::collections::BTreeMap;

use kinds_model::mixture::most_probable;
use kinds_model::{FitPlan, Model, Origin, Register, ResponsePlan, Scale, SensorLayout, fit};
use kinds_trips::{Command, Pose};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use roxmltree::{Document, Node, ParsingOptions};

use super::kind_style::KindStyle;
use super::*;
use crate::consistency::kappa;
use crate::rivals::Methods;
use crate::scores::{Confidence, DirectedScores, KappaLead, MethodScores, Scores};
use crate::surface::{Grid, Surface};
use crate::track::Track;
use crate::trip_kinds::TripKinds;
use crate::{
    ClassifiedTrip, Consistency, Evaluation, Jittered, MapPlan, PairScores, Policy, RegistrationScores,
    SegmentFormat, Segmentation, SegmentationAgreement, Sequence, Uses,
};

/// A model of a robot that goes from place to place, over and over: 120 frames in one, 80 and 40 in others.
fn model(sensor: SensorLayout, scale: Scale, n_dims: usize, n_kinds: usize) -> Model {
    model_keeping(usize::MAX, sensor, scale, n_dims, n_kinds)
}

/// The same, learnt from all 240 frames, but with only so many for reference.
fn model_keeping(
    n_frames_max: usize,
    sensor: SensorLayout,
    scale: Scale,
    n_dims: usize,
    n_kinds: usize,
) -> Model {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let mut counts = Vec::new();
    for index in 0..240 {
        let place = [0, 0, 0, 1, 1, 2][index / 20 % 6];
        for reading in 0..sensor.n_readings() {
            let toward = reading % 3 == place;
            let range_mm = if toward { 3000.0 } else { 600.0 + 300.0 * place as f64 };
            counts.push((range_mm + random.random_range(-150.0..150.0)) as u16);
        }
    }
    let plan = FitPlan {
        n_frames_max,
        n_neighbors: Some(8),
        n_landmarks: 60,
        n_dims: Some(n_dims),
        n_kinds: Some(n_kinds),
        ..FitPlan::new(sensor, ResponsePlan::new(scale, 4.0), 1)
    };
    fit(counts, &plan, Origin::default(), &mut |_, _, _| ()).unwrap()
}

fn ring() -> Model {
    model(SensorLayout { rows: 2, columns: 8, metres_per_count: 0.001 }, Scale::Inverse, 3, 3)
}

/// [`ring`] with a quarter of its frames for reference.
fn thinned_ring() -> Model {
    model_keeping(60, ring().layout(), Scale::Inverse, 3, 3)
}

fn camera() -> Model {
    model(SensorLayout { rows: 6, columns: 8, metres_per_count: 0.001 }, Scale::Inverse, 3, 3)
}

const fn at(x_m: f64, y_m: f64) -> Option<Pose> {
    Some(Pose { x_m, y_m, yaw_rad: 0.0 })
}

/// A metre and a tenth of a second a frame; frames 0, 1 and 4 of kind 0, 2 and 3 of kind 1.
const TRIP: TripKinds = TripKinds {
    title: "trip <1>",
    seconds: &[0.0, 0.1, 0.2, 0.3, 0.4],
    poses: &[at(0.0, 2.0), at(1.0, 2.0), at(2.0, 2.0), at(3.0, 2.0), at(4.0, 2.0)],
    commands: &[],
    kinds: &[0, 0, 1, 1, 0],
};

fn path() -> Figure {
    kinds_on_path("path", "Kinds on the <path>", &Register::new(2), &[TRIP])
}

fn along_time() -> Figure {
    kinds_along_time("time", "Kinds along time", &Register::new(2), &[TRIP])
}

fn scores() -> Scores {
    let score = |n_dims, consistency: f64, chance: f64| MethodScores {
        n_dims,
        n_kinds: 5,
        consistency,
        chance,
        kappa: kappa(Consistency { consistency, chance }),
        ami: 0.5,
        largest_kind_share: 0.375,
        area: Some(0.7),
        chance_area: Some(0.25),
        confidence: (n_dims > 0).then_some(Confidence {
            consistency: [consistency - 0.1, consistency + 0.1],
            kappa: [0.4, 0.8],
            ami: [0.45, 0.55],
            area: None,
        }),
    };
    let methods = Methods {
        isomap: score(8, 0.8, 0.2),
        pca: Some(score(8, 0.6, 0.2)),
        native: None,
        random: score(0, 0.2, 0.25),
    };
    Scores { radius_m: 0.3, share: 0.5, revisited: 0.9, methods }
}

fn grid() -> Grid {
    Grid::new(0.4, 2, 3)
}

fn all_surfaces() -> Methods<Surface> {
    let surface = |values: [Option<f64>; 3]| Surface {
        consistency: vec![vec![None; 3], values.to_vec()],
        chance: vec![vec![None; 3], vec![Some(0.25); 3]],
        area: Some(0.5),
        chance_area: Some(0.25),
    };
    Methods {
        isomap: surface([Some(1.0), Some(0.5), Some(0.1)]),
        pca: Some(surface([Some(0.9), None, Some(0.0)])),
        native: None,
        random: surface([None; 3]),
    }
}

fn surfaces() -> Figure {
    consistency_surfaces("surfaces", "Surfaces of <kinds>", &grid(), &all_surfaces())
}

fn registration_scores() -> Vec<RegistrationScores> {
    let jittered = |kappa| Jittered { consistency: 0.5, kappa, kappa_range: [kappa - 0.1, kappa + 0.1] };
    vec![
        RegistrationScores { sigma_m: 0.1, each_pose: Some(jittered(0.5)), whole_trip: Some(jittered(-0.2)) },
        RegistrationScores { sigma_m: 0.2, each_pose: None, whole_trip: Some(jittered(0.1)) },
    ]
}

/// A trip that is steered left in kind 0, and left or right in kind 1.
fn told() -> Figure {
    let turn = |turn_rad_s| Some(Command { forward_m_s: 0.5, turn_rad_s });
    let commands = [turn(1.0), turn(0.9), turn(1.0), turn(-1.0), None];
    let trip = TripKinds { commands: &commands, ..TRIP };
    commands_figure(&trip)
}

fn commands_figure(trip: &TripKinds) -> Figure {
    commands("commands", "Commands <in> each kind", &Register::new(2), &[*trip], &Policy::of(&[*trip], 2, 0))
}

fn named() -> SegmentationAgreement {
    let text = "from_s,to_s,name\n0,0.25,<hall>\n0.25,1,door\n";
    Segmentation::parse(text, SegmentFormat::Csv, &[TRIP]).unwrap().compare(&[TRIP], 2)
}

fn registration() -> Figure {
    registration_errors("registration", "When poses are off", 0.7, &registration_scores())
}

fn directed() -> DirectedScores {
    DirectedScores {
        scores: scores(),
        never_revisited: 0.1,
        block_m: 2.5,
        n_blocks: 12,
        kappa_lead: Some(KappaLead { isomap_over_pca: 0.25, confidence: Some([-0.04, 0.5]) }),
        kinds_met: vec![vec![7, 1], vec![0, 0]],
        surfaces: all_surfaces(),
    }
}

fn evaluation() -> Evaluation {
    let pair = |space| PairScores {
        space,
        trips: ["first".to_string(), "second".to_string()],
        forward: directed(),
        backward: DirectedScores {
            kappa_lead: Some(KappaLead { isomap_over_pca: 0.25, confidence: Some([0.1, 0.5]) }),
            ..directed()
        },
        registration: registration_scores(),
    };
    Evaluation {
        scores: Some(scores()),
        method: "isomap",
        grid: grid(),
        pairs: vec![pair(0), pair(1)],
        not_compared: vec!["third has no poses".to_string()],
        remarks: Vec::new(),
        trips: Vec::new(),
    }
}

fn figures() -> Vec<Figure> {
    let (ring, camera) = (ring(), camera());
    let plain = [
        residual_variance(&[("Isomap", &ring), ("another & its <name>", &camera)]),
        spectrum(&ring),
        embedding(&ring),
        canonical_views(&ring),
        path(),
        along_time(),
        consistency("consistency", "Consistency by method", &scores()),
        surfaces(),
        registration(),
        kinds_met(
            "kinds-met",
            "Which for which",
            &Register::new(2),
            ["a", "b & c"],
            &[vec![7, 1], vec![0, 0]],
        ),
        topology::figure(),
        transitions("transitions", "What <follows> what", &Register::new(2), &[Sequence::of(&TRIP, 2)]),
        run_lengths("run-lengths", "How long", &Register::new(2), &[TRIP]),
        told(),
        names_and_kinds("segmentation", "Names & kinds", &Register::new(2), &named()),
    ];
    let plain = plain.into_iter().chain(kinds_merged(&ring));
    plain.chain(kinds_tried::tests::figure()).chain(neighbors_tried::tests::figure()).collect()
}

fn page() -> Page {
    let mut page = Page::new("Kinds of <crunch> & \"ring\"");
    page.section("1 < 2");
    page.paragraph("</p><script>alert('kinds')</script>");
    page.list(["a & b"]);
    page.facts(&[("sensor <x>", "16 & more".to_string())]);
    page.table(&consistency_table(&scores()));
    figures().into_iter().for_each(|figure| page.figure(figure));
    page
}

const SVG: &str = "http://www.w3.org/2000/svg";

fn parse(markup: &str) -> Document<'_> {
    let options = ParsingOptions { allow_dtd: true, ..ParsingOptions::default() };
    Document::parse_with_options(markup, options).unwrap()
}

fn with_class<'a>(document: &'a Document, class: &str) -> Vec<Node<'a, 'a>> {
    let has = |node: &Node| node.attribute("class").is_some_and(|all| all.split(' ').any(|one| one == class));
    document.descendants().filter(has).collect()
}

fn texts(svg: &str) -> Vec<String> {
    let document = parse(svg);
    let texts = document.descendants().filter(|node| node.has_tag_name((SVG, "text")));
    texts.filter_map(|node| node.text().map(str::to_string)).collect()
}

/// Lines of numbers, without titles.
fn lines(csv: &str) -> Vec<Vec<&str>> {
    csv.lines().skip(1).map(|line| line.split(',').collect()).collect()
}

#[test]
fn pages_and_figures_are_well_formed_and_say_what_was_given_to_them() {
    let html = page().to_html();
    let document = parse(&html);
    let text_of =
        |tag: &str| document.descendants().find(|node| node.has_tag_name(tag)).and_then(|node| node.text());
    assert_eq!(text_of("title"), Some("Kinds of <crunch> & \"ring\""));
    assert_eq!(text_of("h1"), Some("Kinds of <crunch> & \"ring\""));
    assert_eq!(text_of("h2"), Some("1 < 2"));
    assert_eq!(text_of("p"), Some("</p><script>alert('kinds')</script>"));
    assert_eq!(text_of("li"), Some("a & b"));
    assert_eq!((text_of("dt"), text_of("dd")), (Some("sensor <x>"), Some("16 & more")));
    for figure in figures() {
        let svg = figure.to_svg();
        let document = parse(&svg);
        let title = document.root_element().children().find(|node| node.has_tag_name((SVG, "title")));
        assert_eq!(title.and_then(|node| node.text()), Some(figure.title()));
        assert!(
            document
                .descendants()
                .any(|node| node.has_tag_name((SVG, "text")) && node.text() == Some(figure.title()))
        );
    }
}

#[test]
fn a_report_needs_no_network_and_runs_no_script() {
    for file in page().files() {
        let contents = file.contents.replace("xmlns=\"http://www.w3.org/2000/svg\"", "");
        // The data of an image may have any letters.
        let parts = contents.split("base64,").enumerate();
        let parts =
            parts.map(|(index, part)| if index == 0 { part } else { &part[part.find('"').unwrap()..] });
        let contents: String = parts.collect();
        for word in ["http", "<script", "javascript:", "@import", "url(", "<link", "//", "src="] {
            assert!(!contents.contains(word), "{} has {word}", file.name);
        }
    }
}

#[test]
fn a_report_is_its_page_and_two_files_for_each_figure() {
    let mut page = Page::new("Kinds");
    page.figure(path());
    let files = page.files();
    let names: Vec<&str> = files.iter().map(|file| file.name.as_str()).collect();
    assert_eq!(names, ["report.html", "path.svg", "path.csv"]);
    assert_eq!(files[1].contents, path().to_svg());
    assert_eq!(files[2].contents, path().csv());
}

#[test]
fn text_in_figures_is_at_least_11_px_high_on_a_page_400_px_wide_and_every_picture_has_words() {
    const PAGE_PX: f64 = 400.0 - 2.0 * 16.0;
    let html = page().to_html();
    let document = parse(&html);
    let pictures = with_class(&document, "picture");
    assert!(pictures.len() > 10);
    for picture in pictures {
        let width: f64 = picture.attribute("width").unwrap().parse().unwrap();
        assert!(13.0 * (PAGE_PX / width).min(1.0) >= 11.0, "{width} px");
        assert_eq!(picture.attribute("role"), Some("img"));
        assert!(!picture.attribute("aria-label").unwrap().is_empty());
    }
    assert!(html.contains("font-size:13px"));
}

/// The canonical views by the plain formulas, on a scale whose inverse is a unit alone.
#[test]
fn methods_are_written_with_kappa_and_random_kinds_without_dimensions() {
    let svg = consistency("consistency", "Consistency", &scores()).to_svg();
    let names: Vec<String> = texts(&svg).into_iter().filter(|text| text.contains("κ")).collect();
    assert_eq!(names, ["Isomap, κ = 0.75", "PCA, κ = 0.50", "random, κ = −0.07"]);
    let mut page = Page::new("Kinds");
    page.table(&consistency_table(&scores()));
    let html = page.to_html();
    let document = parse(&html);
    let rows: Vec<String> = document
        .descendants()
        .filter(|node| node.has_tag_name("tr"))
        .map(|row| {
            row.children()
                .filter_map(|cell| cell.text())
                .collect::<Vec<_>>()
                .join(" | ")
                .replace('\u{a0}', " ")
        })
        .collect();
    assert_eq!(
        rows,
        [
            "method | dimensions | kinds | consistency | chance | κ | 95 % of κ | AMI | area | largest kind",
            "Isomap | 8 | 5 | 80.0 % | 20.0 % | 0.75 | 0.40 … 0.80 | 0.50 | 70.0 % | 37.5 %",
            "PCA | 8 | 5 | 60.0 % | 20.0 % | 0.50 | 0.40 … 0.80 | 0.50 | 70.0 % | 37.5 %",
            "random | – | 5 | 20.0 % | 25.0 % | −0.07 | – | 0.50 | 70.0 % | 37.5 %",
        ]
    );
}

#[test]
fn native_space_stands_beside_the_methods_that_it_is_compared_with() {
    let plain = scores();
    let native = MethodScores { n_dims: 16, ..plain.methods.isomap };
    let with_native = Scores { methods: Methods { native: Some(native), ..plain.methods }, ..plain };
    let figure = consistency("consistency", "Consistency", &with_native);
    let rows: Vec<Vec<&str>> = lines(figure.csv());
    let named: Vec<[&str; 2]> = rows.iter().map(|row| [row[0], row[1]]).collect();
    assert_eq!(named, [["Isomap", "8"], ["PCA", "8"], ["native space", "16"], ["random", "0"]]);
    assert!(figure.caption().ends_with(" Isomap and PCA at 8 dimensions and 5 kinds."));
    assert!(
        consistency("consistency", "Consistency", &scores())
            .caption()
            .ends_with(" All at 8 dimensions and 5 kinds.")
    );
}

#[test]
fn a_figure_of_its_own_has_its_colours_in_light_and_dark_and_everything_within_its_sheet() {
    for figure in figures() {
        let svg = figure.to_svg();
        assert!(!svg.contains("var("), "{}", figure.name());
        assert!(svg.contains("@media screen and (prefers-color-scheme:dark)"));
        let document = parse(&svg);
        let size = |name: &str| document.root_element().attribute(name).unwrap().parse::<f64>().unwrap();
        for part in document.root_element().children().filter_map(|node| node.attribute("transform")) {
            let places = part.trim_start_matches("translate(").trim_end_matches(')').split_once(' ').unwrap();
            let (x, y): (f64, f64) = (places.0.parse().unwrap(), places.1.parse().unwrap());
            assert!(x >= 0.0 && x < size("width") && y > 36.0 && y < size("height"), "{part}");
        }
    }
}
