//! Segmentations of made-up trips, counted by hand.

use proptest::prelude::*;

use super::*;

/// A frame a second.
const HALL: TripKinds = TripKinds {
    title: "hall",
    seconds: &[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0],
    poses: &[],
    commands: &[],
    kinds: &[0, 0, 0, 1, 1, 2, 1, 1],
};
const YARD: TripKinds = TripKinds {
    title: "yard, rear",
    seconds: &[0.0, 1.0, 2.0, 3.0],
    poses: &[],
    commands: &[],
    kinds: &[0, 0, 1, 1],
};

fn of(text: &str, format: SegmentFormat, trips: &[TripKinds]) -> Result<Segmentation, String> {
    Segmentation::parse(text, format, trips).map_err(|error| error.to_string())
}

const TABLE: &str =
    "trip,from_s,to_s,name\nhall,0,3,corridor\nhall,3,7,\"door, open\"\n\"yard, rear\",1,4,corridor\n";

#[test]
fn names_and_kinds_are_compared_as_by_hand() {
    let segmentation = of(TABLE, SegmentFormat::Csv, &[HALL, YARD]).unwrap();
    let found = segmentation.compare(&[HALL, YARD], 4);
    assert_eq!((found.n_frames, found.n_frames_named), (12, 10));
    assert_eq!(found.names, ["corridor", "door, open"]);
    // Corridor: kinds 0 0 0 in the hall, 0 1 1 in the yard. Door: 1 1 2 1.
    assert_eq!(found.n_frames_of, [[4, 2, 0, 0], [0, 3, 1, 0]]);
    assert_eq!(found.usual_kinds, [0, 1]);
    let name = |name: &str| Some(name.to_string());
    assert_eq!(found.usual_names, [name("corridor"), name("door, open"), name("door, open"), None]);
    let pairs = [(0, 0), (0, 0), (0, 0), (1, 1), (1, 1), (1, 2), (1, 1), (0, 0), (0, 1), (0, 1)];
    assert_eq!(found.ami, crate::adjusted_mutual_information(&pairs));
    let differs = |trip: &str, from_s, to_s, n_frames, name: &str, usual_kind, kind| KindDiffers {
        trip: trip.to_string(),
        from_s,
        to_s,
        n_frames,
        name: name.to_string(),
        usual_kind,
        kind,
    };
    assert_eq!(
        found.kinds_differ,
        [
            differs("yard, rear", 2.0, 4.0, 2, "corridor", 0, 1),
            differs("hall", 5.0, 6.0, 1, "door, open", 1, 2)
        ]
    );
    let [differs] = &found.names_differ[..] else { panic!("{:?}", found.names_differ) };
    assert_eq!(
        (differs.trip.as_str(), differs.from_s, differs.to_s, differs.n_frames, differs.kind),
        ("yard, rear", 2.0, 4.0, 2, 1)
    );
    assert_eq!((differs.usual_name.as_str(), differs.name.as_str()), ("door, open", "corridor"));
}

#[test]
fn tables_of_spreadsheets_and_lists_say_the_same() {
    let plain = of(TABLE, SegmentFormat::Csv, &[HALL, YARD]).unwrap();
    let spreadsheet = format!("\u{feff}{}", TABLE.replace('\n', "\r\n"));
    assert_eq!(of(&spreadsheet, SegmentFormat::Csv, &[HALL, YARD]), Ok(plain.clone()));
    let list = "[(trip: \"hall\", from_s: 0, to_s: 3, name: \"corridor\"), (trip: \"hall\", from_s: 3, to_s: 7.0, name: \"door, open\"),
        (trip: \"yard, rear\", from_s: 1, to_s: 4, name: \"corridor\")]";
    let listed = of(list, SegmentFormat::Ron, &[HALL, YARD]).unwrap();
    assert_eq!(listed.compare(&[HALL, YARD], 3), plain.compare(&[HALL, YARD], 3));
    // Of a single trip, which one need not be said.
    let one = of("from_s,to_s,name\n2,4,corridor\n", SegmentFormat::Csv, &[HALL]).unwrap();
    assert_eq!(of("trip,from_s,to_s,name\n,2,4,corridor\n", SegmentFormat::Csv, &[HALL]), Ok(one.clone()));
    let listed = of("[(from_s: 2, to_s: 4, name: \"corridor\")]", SegmentFormat::Ron, &[HALL]).unwrap();
    assert_eq!(listed.compare(&[HALL], 3), one.compare(&[HALL], 3));
}

#[test]
fn what_is_wrong_is_said_with_its_place_and_what_to_do() {
    let check = |text: &str, expected: &str| {
        assert_eq!(of(text, SegmentFormat::Csv, &[HALL, YARD]).unwrap_err(), expected);
    };
    let with = |row: &str| format!("trip,from_s,to_s,name\nhall,0,3,corridor\n{row}\n");
    check("", "there is no interval in it; give at least one as trip, from_s, to_s and name");
    check(
        "trip,from_s,to_s,name\n",
        "there is no interval in it; give at least one as trip, from_s, to_s and name",
    );
    check(&with("hall,3,4,"), "line 3: the interval has no name; give it one");
    check(
        &with("hall,4,4,door"),
        "line 3: the interval goes from 4 s to 4 s; its end must come after its start",
    );
    check(&with("hall,NaN,4,door"), "line 3: the interval goes from NaN s to 4 s; both must be finite");
    check(
        &with("attic,4,5,door"),
        "line 3: there is no trip attic; those that are evaluated are hall, yard, rear",
    );
    check(
        &with(",4,5,door"),
        "line 3: the interval names no trip, and there are several; it must be one of hall, yard, rear",
    );
    check(
        &with("hall,2.5,5,door"),
        "line 3: the interval from 2.5 s overlaps that of line 2, which ends at 3 s; each time of a trip has one name",
    );
    check(
        &with("hall,20,30,door"),
        "line 3: no frame of hall lies between 20 s and 30 s; its frames are from 0.0 s to 7.0 s after the trip's first",
    );
    check(&with("hall,three,4,door"), "line 3: from_s is \"three\"; it must be a number of seconds");
    check(
        &with("hall,3,4,door, open"),
        "line 3: the row has 5 cells and there are 4 titles; put names with commas in quotation marks",
    );
    check(
        "trip,begin,to_s,name\nhall,0,3,corridor\n",
        "line 1: there is a column begin; the titles must be trip (which may be left out), from_s, to_s, name",
    );
    check(
        "trip,to_s,name\nhall,3,corridor\n",
        "line 1: there is no column from_s; the titles must be trip (which may be left out), from_s, to_s, name",
    );
    assert_eq!(
        of(&with("hall,3,4,door"), SegmentFormat::Csv, &[HALL, YARD, HALL]).unwrap_err(),
        "line 2: 2 of the trips are called hall; give their files different names"
    );
    let ron = |text: &str| of(text, SegmentFormat::Ron, &[HALL]).unwrap_err();
    let unknown = ron("[\n  (from_s: 0, until_s: 3, name: \"corridor\"),\n]");
    assert!(unknown.starts_with("line 2, column ") && unknown.contains("until_s"), "{unknown}");
    assert_eq!(
        ron("[(from_s: 0, to_s: 2, name: \"a\"), (from_s: 1, to_s: 3, name: \"b\")]"),
        "interval 2: the interval from 1 s overlaps that of interval 1, which ends at 2 s; each time of a trip has one name"
    );
}

proptest! {
    #[test]
    fn a_segmentation_that_is_the_kinds_by_other_names_agrees_wholly(kinds in prop::collection::vec(0..4_usize, 1..60)) {
        let seconds: Vec<f64> = (0..kinds.len()).map(|frame| frame as f64 / 2.0).collect();
        let trip = TripKinds { title: "trip", seconds: &seconds, poses: &[], commands: &[], kinds: &kinds };
        let rows: String = crate::runs::runs(&kinds)
            .map(|(frames, kind)| format!("{},{},place {kind}\n", frames.start as f64 / 2.0, frames.end as f64 / 2.0))
            .collect();
        let segmentation = of(&format!("from_s,to_s,name\n{rows}"), SegmentFormat::Csv, &[trip]).unwrap();
        let found = segmentation.compare(&[trip], 4);
        prop_assert_eq!(found.n_frames_named, kinds.len());
        prop_assert!((found.ami - 1.0).abs() < 1e-9, "{}", found.ami);
        prop_assert!(found.kinds_differ.is_empty() && found.names_differ.is_empty());
    }
}
