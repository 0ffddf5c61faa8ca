//! What kinds are called: by the numbers that they keep and the names that people gave them, wherever they stand.

use super::*;
use crate::policy::CommandMode;

/// Of a model that was updated, so that numbers are not indices.
fn updated() -> Register {
    let kinds = "(number: 3, name: \"<place> 3\", note: \"\"), (number: 7, name: \"\", note: \"\"), \
                 (number: 12, name: \"<place> 12\", note: \"\")";
    ron::from_str(&format!("(kinds: [{kinds}], retired: [(number: 0, name: \"\", note: \"\")])")).unwrap()
}

fn named_ring(name: &str) -> Model {
    let mut ring = ring();
    for number in 0..3 {
        ring.name_kind(number, Some(&format!("{name} {number}")), None).unwrap();
    }
    ring
}

/// All that is made of trips.
fn page_of_trips(register: &Register) -> Page {
    let turn = |turn_rad_s| Some(Command { forward_m_s: 0.5, turn_rad_s });
    let track = Track {
        title: "trip".to_string(),
        seconds: TRIP.seconds.to_vec(),
        poses: TRIP.poses.to_vec(),
        commands: [0.1, 0.2, 0.3, 0.2, 0.1].map(turn).to_vec(),
    };
    let trips = [ClassifiedTrip { space: 0, track, kinds: vec![0, 0, 2, 2, 1], drift: None }];
    let mut uses = Uses::of(&trips, 3, &MapPlan { size_m_min: 0.5, radius_m: 0.2 }, 0);
    let kind = &mut uses[0].policy.kinds[2];
    let mode = CommandMode { n_frames: 1, share: 0.5, command: kind.command.unwrap(), spells: Vec::new() };
    kind.modes = vec![mode.clone(), mode];
    let mut page = Page::new("Kinds");
    add_classified_trips(&mut page, register, &trips);
    let mut evaluation = evaluation();
    evaluation.pairs[0].forward.kinds_met = vec![vec![7, 0, 1], vec![0, 1, 0], vec![5, 0, 1]];
    add_evaluation(&mut page, register, &evaluation);
    add_uses(&mut page, register, &trips, &uses);
    add_segmentation(&mut page, register, &named());
    page
}

/// Every kind that a text names has one of the register's numbers, with its name behind it.
fn check_names(text: &str, register: &Register) -> usize {
    let mut n_named = 0;
    for after in text.split("kind ").skip(1).chain(text.split("Kind ").skip(1)) {
        let digits: String = after.chars().take_while(char::is_ascii_digit).collect();
        let Ok(number) = digits.parse::<u32>() else { continue };
        let is_it = |kind: &usize| register.number(*kind) == number;
        let kind = (0..3).find(is_it).unwrap_or_else(|| panic!("{text:?}: there is no kind {number}"));
        assert!(after.starts_with(&register.label(kind)), "{text:?}: kind {number} without its name");
        n_named += 1;
    }
    n_named
}

/// Checks a page, and the columns of kinds in its files. Returns on how many texts a kind is named.
fn check_page(page: &Page, register: &Register, n_columns: usize) -> usize {
    let html = page.to_html();
    assert!(!html.contains("<place>"), "names are text");
    let document = parse(&html);
    let said = document.descendants().filter_map(|node| match node.is_text() {
        true => node.text(),
        false => node.attribute("aria-label"),
    });
    let n_named = said.map(|text| check_names(text, register)).sum();

    let columns =
        ["kind", "next_kind", "kind_met", "first_kind_of_group", "first_kind_of_group_that_joins_it"];
    let mut n_checked = 0;
    for file in page.files().iter().filter(|file| file.name.ends_with(".csv")) {
        let titles: Vec<&str> = file.contents.lines().next().unwrap().split(',').collect();
        for column in (0..titles.len()).filter(|&column| columns.contains(&titles[column])) {
            // Of edges of a map there is none.
            for cell in lines(&file.contents).iter().map(|line| line[column]).filter(|cell| !cell.is_empty())
            {
                let is_number = register.kinds().iter().any(|record| record.number.to_string() == cell);
                assert!(is_number, "{} has a kind {cell}", file.name);
            }
            n_checked += 1;
        }
    }
    assert_eq!(n_checked, n_columns);
    n_named
}

#[test]
fn kinds_are_called_by_number_and_name_wherever_they_stand_on_the_page_of_an_evaluation() {
    let register = updated();
    let page = page_of_trips(&register);
    // Of what follows what, and of what is taken for what on each of two pairs, two; of path, time, lengths, map, commands and
    // a person's names, one.
    let n_named = check_page(&page, &register, 12);
    // Four legends of three kinds, and what else there is: captions, headings, tables.
    assert!(n_named > 4 * 3, "{n_named}");
    let html = page.to_html();
    let document = parse(&html);
    let label = register.label(0);
    let n_labels = |tag: &str| {
        let nodes = document.descendants().filter(|node| node.tag_name().name() == tag);
        nodes.filter(|node| node.text() == Some(&label)).count()
    };
    assert_eq!(n_labels("td"), 2, "regions and commands");
    assert_eq!(n_labels("text"), 3, "rows of what follows what and, twice, of what is taken for what");
    assert!(html.contains("Kind 12 (&lt;place&gt; 12) is perceptually aliased"));
    let attached = |name: &str| page.files().into_iter().find(|file| file.name == name).unwrap().contents;
    let (dot, graphml) = (attached("map.dot"), attached("map.graphml"));
    assert_eq!(check_names(&dot, &register), 2, "{dot}");
    for number in [3, 12] {
        assert!(dot.contains(&format!(", kind={number},")), "{dot}");
        assert!(graphml.contains(&format!("<data key=\"node_kind\">{number}</data>")), "{graphml}");
    }
}

#[test]
fn kinds_are_called_by_number_and_name_wherever_they_stand_on_the_page_of_a_model() {
    let ring = named_ring("<place>");
    let mut page = Page::new("Kinds");
    add_model(&mut page, &ring, None, &[]);
    // The embedding, what each looks like, and two of which are most alike.
    let n_named = check_page(&page, ring.register(), 4);
    // A legend, a heading of each and the tree; the first two with words for a screen reader, too.
    assert!(n_named >= 5 * 3, "{n_named}");
}

#[test]
fn figures_that_have_room_for_numbers_alone_say_names_in_a_legend_if_there_are_any() {
    let mut ring = ring();
    let legends = |model: &Model| {
        let register = model.register();
        let figures = [
            kinds_along_time("time", "Time", register, &[TRIP]),
            run_lengths("run-lengths", "How long", register, &[TRIP]),
        ];
        figures.map(|figure| {
            texts(&figure.to_svg()).into_iter().filter(|text| text.starts_with("kind ")).count()
        })
    };
    assert_eq!(legends(&ring), [0, 0]);
    ring.name_kind(1, Some("doorway"), None).unwrap();
    assert_eq!(legends(&ring), [3, 3]);
}

#[test]
fn the_longest_name_stays_on_its_sheet() {
    let ring = named_ring(&"M".repeat(38));
    let mut page = page_of_trips(ring.register());
    add_model(&mut page, &ring, None, &[]);
    let html = page.to_html();
    let document = parse(&html);
    let sheets = with_class(&document, "picture");
    for sheet in sheets {
        let width: f64 = sheet.attribute("width").unwrap().parse().unwrap();
        for text in sheet.descendants().filter(|node| node.text().is_some_and(|text| text.contains("MMM"))) {
            let Some(x) = text.attribute("x").and_then(|x| x.parse::<f64>().ok()) else { continue };
            // As letters are reckoned with everywhere: 7 px, bold ones 8.
            let is = |class: &str| {
                text.attribute("class").is_some_and(|all| all.split(' ').any(|one| one == class))
            };
            let letter_px = if is("name") { 8.0 } else { 7.0 };
            let length = letter_px * text.text().unwrap().chars().count() as f64;
            let (left, right) = if is("end") { (x - length, x) } else { (x, x + length) };
            assert!(left >= 0.0 && right <= width, "{left} … {right} of {width}: {:?}", text.text());
        }
    }
}
