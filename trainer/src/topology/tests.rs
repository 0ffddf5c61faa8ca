//! Maps of made-up trips, where regions, edges and numbers are known.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::TAU;

use kinds_model::Register;
use kinds_trips::Command;
use proptest::prelude::*;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use roxmltree::Document;

use super::*;

/// A trip that owns what it is made of.
#[derive(Clone, Debug, Default)]
struct Trip {
    seconds: Vec<f64>,
    poses: Vec<Option<Pose>>,
    commands: Vec<Option<Command>>,
    kinds: Vec<usize>,
}

fn at(x_m: f64, y_m: f64) -> Option<Pose> {
    Some(Pose { x_m, y_m, yaw_rad: 0.0 })
}

impl Trip {
    /// Through these places, one a second.
    fn through(poses: Vec<Option<Pose>>, kinds: &[usize]) -> Self {
        let seconds = (0..kinds.len()).map(|index| index as f64).collect();
        Self { seconds, poses, commands: Vec::new(), kinds: kinds.to_vec() }
    }

    /// Along the x axis.
    fn along(x_m: &[f64], kinds: &[usize]) -> Self {
        Self::through(x_m.iter().map(|&x_m| at(x_m, 0.0)).collect(), kinds)
    }

    /// Straight from one place to another, of one kind, five frames a metre.
    fn straight(from: (f64, f64), to: (f64, f64), kind: usize) -> Self {
        let n_steps = (5.0 * (to.0 - from.0).hypot(to.1 - from.1)).round();
        let share = (0..=n_steps as usize).map(|step| step as f64 / n_steps);
        let pose = |share| at(from.0 + share * (to.0 - from.0), from.1 + share * (to.1 - from.1));
        let poses: Vec<Option<Pose>> = share.map(pose).collect();
        let kinds = vec![kind; poses.len()];
        Self::through(poses, &kinds)
    }

    /// The same places in the opposite order.
    fn back(&self) -> Self {
        let reversed = |kinds: &[usize]| kinds.iter().rev().copied().collect();
        Self {
            seconds: self.seconds.iter().rev().map(|time_s| 1000.0 - time_s).collect(),
            poses: self.poses.iter().rev().copied().collect(),
            commands: self.commands.iter().rev().copied().collect(),
            kinds: reversed(&self.kinds),
        }
    }

    fn kinds(&self) -> TripKinds<'_> {
        let Self { seconds, poses, commands, kinds } = self;
        TripKinds { title: "trip", seconds, poses, commands, kinds }
    }
}

fn map(trips: &[Trip], size_m_min: f64, radius_m: f64) -> TopologicalMap {
    let trips: Vec<TripKinds> = trips.iter().map(Trip::kinds).collect();
    TopologicalMap::of(&trips, &MapPlan { size_m_min, radius_m })
}

fn edges(map: &TopologicalMap) -> Vec<(usize, usize, usize)> {
    map.edges.iter().map(|edge| (edge.from, edge.to, edge.n_visits)).collect()
}

/// Bernoulli's lemniscate, 8 m wide, from its right end, 400 frames a lap; poses and kinds are noisy.
///
/// * `loop_kinds` — of the left and the right loop; the crossing, 2.4 m wide, is of kind 0
fn eight(loop_kinds: [usize; 2], n_laps: usize, seed: u64) -> (Trip, Vec<Option<usize>>) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut trip = Trip::default();
    let mut truth = Vec::new();
    // The kind that is seen wrongly, and for how many frames yet.
    let mut flip = (0, 0);
    for frame in 0..=400 * n_laps {
        let turn = TAU * frame as f64 / 400.0;
        let x_m = 4.0 * turn.cos() / (1.0 + turn.sin().powi(2));
        let y_m = x_m * turn.sin();
        let kind = if x_m.abs() < 1.2 { 0 } else { loop_kinds[usize::from(x_m > 0.0)] };
        if flip.1 == 0 && random.random_range(0.0..1.0) < 0.04 {
            flip = (random.random_range(0..4), random.random_range(1..=4));
        }
        trip.kinds.push(if flip.1 > 0 { flip.0 } else { kind });
        flip.1 -= i32::from(flip.1 > 0);
        trip.seconds.push(0.1 * frame as f64);
        let mut noise_m = || random.random_range(-0.04..0.04);
        trip.poses.push(at(x_m + noise_m(), y_m + noise_m()));
        // Regions in the order of their first visits: right, crossing, left. Within a least size of the borders noise may decide:
        // what is cut off there by a flicker, and smaller, goes to either side.
        let region = if x_m > 1.2 {
            0
        } else if x_m > -1.2 {
            1
        } else {
            2
        };
        truth.push(((x_m.abs() - 1.2).abs() > 0.8).then_some(region));
    }
    (trip, truth)
}

#[test]
fn a_figure_of_eight_has_one_crossing_and_two_loops_whether_these_are_of_one_kind_or_two() {
    for loop_kinds in [[1, 2], [1, 1]] {
        for seed in 0..10 {
            let (trip, truth) = eight(loop_kinds, 5, seed);
            let map = map(&[trip], 0.8, 0.35);
            let kinds: Vec<usize> = map.regions.iter().map(|region| region.kind).collect();
            assert_eq!(kinds, [loop_kinds[1], 0, loop_kinds[0]], "{loop_kinds:?}, seed {seed}");
            let n_visits: Vec<usize> = map.regions.iter().map(|region| region.n_visits).collect();
            assert_eq!(n_visits, [6, 10, 5]);
            assert_eq!(edges(&map), [(0, 1, 5), (1, 0, 5), (1, 2, 5), (2, 1, 5)]);
            for (found, expected) in map.regions_of_frames[0].iter().zip(&truth) {
                assert!(expected.is_none() || found == expected, "{found:?}, not {expected:?}");
            }
            let [right, crossing, left] = [0, 1, 2].map(|index| map.regions[index].extent);
            assert!(left.x_m_max < -0.36 && right.x_m_min > 0.36, "{left:?} {right:?}");
            assert!(crossing.x_m_min > -2.04 && crossing.x_m_max < 2.04, "{crossing:?}");
        }
    }
}

/// There and back, and once more there, half as fast.
///
/// Frame of the first trip:  0 1 2 3 4 5 6 7 8 9 10
/// place, m:                 0 1 2 3 4 5 4 3 2 1 0
/// kind:                     0 0 0 1 1 1 1 1 0 0 0
fn there_and_back() -> [Trip; 2] {
    let kinds = [0, 0, 0, 1, 1, 1, 1, 1, 0, 0, 0];
    let mut back = Trip::along(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 4.0, 3.0, 2.0, 1.0, 0.0], &kinds);
    let command = |index: i32| Command { forward_m_s: 0.5 * f64::from(index), turn_rad_s: -f64::from(index) };
    back.commands = (0..11).map(|index| (index != 1).then(|| command(index))).collect();
    let mut there = Trip::along(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0], &kinds[..6]);
    there.seconds.iter_mut().for_each(|time_s| *time_s *= 2.0);
    [back, there]
}

#[test]
fn dwell_times_durations_counts_and_commands_are_those_computed_by_hand() {
    let map = map(&there_and_back(), 1.0, 0.6);
    let region = |kind, x_m, (x_m_min, x_m_max), n_visits, n_frames| Region {
        kind,
        x_m,
        y_m: 0.0,
        extent: Extent { x_m_min, x_m_max, y_m_min: 0.0, y_m_max: 0.0 },
        // 2.5 s, 2.5 s and 5 s; 5 s and 5 s: the border is passed half way between two frames.
        dwell_s: 10.0,
        n_visits,
        n_frames,
    };
    // Places 3 4 5 4 3 and 3 4 5 have the mean 3.875 m, and the robot was at 4 m.
    assert_eq!(map.regions, [region(0, 1.0, (0.0, 2.0), 3, 9), region(1, 4.0, (3.0, 5.0), 2, 8)]);
    let edge = |from, to, n_visits, mean_duration_s, mean_forward_m_s, mean_turn_rad_s| {
        let mean_command = Some(MeanCommand { mean_forward_m_s, mean_turn_rad_s });
        Edge { from, to, n_visits, mean_duration_s, mean_command }
    };
    // Frames 0 and 2 of the first trip have commands, and 3 to 7; the second trip has none.
    assert_eq!(map.edges, [edge(0, 1, 2, 3.75, 0.5, -1.0), edge(1, 0, 1, 5.0, 2.5, -5.0)]);
    let [back, there] = &map.regions_of_frames[..] else { panic!("two trips") };
    assert_eq!(back[..], [0, 0, 0, 1, 1, 1, 1, 1, 0, 0, 0].map(Some));
    assert_eq!(there[..], [0, 0, 0, 1, 1, 1].map(Some));
}

#[test]
fn scripts_read_the_plan_and_all_numbers_and_no_command_where_none_is_known() {
    let [_, there] = there_and_back();
    let json = serde_json::to_value(map(&[there], 1.0, 0.6)).unwrap();
    let expected = serde_json::json!({
        "size_m_min": 1.0,
        "radius_m": 0.6,
        "regions": [
            {"kind": 0, "x_m": 1.0, "y_m": 0.0, "x_m_min": 0.0, "x_m_max": 2.0, "y_m_min": 0.0, "y_m_max": 0.0,
             "dwell_s": 5.0, "n_visits": 1, "n_frames": 3},
            {"kind": 1, "x_m": 4.0, "y_m": 0.0, "x_m_min": 3.0, "x_m_max": 5.0, "y_m_min": 0.0, "y_m_max": 0.0,
             "dwell_s": 5.0, "n_visits": 1, "n_frames": 3},
        ],
        "edges": [{"from": 0, "to": 1, "n_visits": 1, "mean_duration_s": 5.0}],
    });
    assert_eq!(json, expected);
}

#[test]
fn small_runs_are_absorbed_the_smallest_first_by_both_neighbours_of_a_kind_or_by_the_larger() {
    // Half a metre a frame, less than 1.1 m is small: three frames or less.
    let check = |kinds: &str, expected: &str| {
        let kinds: Vec<usize> = kinds.bytes().map(|kind| usize::from(kind - b'a')).collect();
        let x_m: Vec<f64> = (0..kinds.len()).map(|index| 0.5 * index as f64).collect();
        let trip = Trip::along(&x_m, &kinds);
        let found = stretches::cut(&trip.kinds(), 1.1);
        let found: Vec<String> = found
            .iter()
            .map(|stretch| {
                char::from(b'a' + stretch.kind as u8).to_string().repeat(stretch.last - stretch.first + 1)
            })
            .collect();
        assert_eq!(found.join(" "), expected);
    };
    check("aaaabbbb", "aaaa bbbb");
    // By both neighbours of one kind, though a third kind flickers in between.
    check("aaaabaaaa", "aaaaaaaaa");
    check("aaaabcbaaaa", "aaaaaaaaaaa");
    // By the larger; of equals by the earlier.
    check("aaaabcccccc", "aaaa ccccccc");
    check("aaaabcccc", "aaaaa cccc");
    // At the ends.
    check("baaaab", "aaaaaa");
    // A flicker has no larger kind: the first of equals gives way.
    check("abababab", "bbbbbbbb");
    // Two small runs make a large one.
    check("aaabcaaa", "aaaaaaaa");
    // Small altogether.
    check("ab", "bb");
    check("a", "a");
}

#[test]
fn visits_are_of_one_region_where_the_middle_half_of_either_lies_at_the_other() {
    let check = |words: &str, ways: &[[(f64, f64); 2]], expected: &[usize]| {
        let there: Vec<Trip> = ways.iter().map(|[from, to]| Trip::straight(*from, *to, 0)).collect();
        let back: Vec<Trip> = ways.iter().map(|[from, to]| Trip::straight(*to, *from, 0)).collect();
        for trips in [there, back] {
            let map = map(&trips, 0.0, 0.5);
            let found: Vec<usize> = map.regions_of_frames.iter().map(|regions| regions[0].unwrap()).collect();
            assert_eq!(found, expected, "{words}");
        }
    };
    let whole = [(0.0, 0.0), (8.0, 0.0)];
    check("a corridor and itself", &[whole, whole], &[0, 0]);
    check("a parallel way beside it", &[whole, [(0.0, 0.4), (8.0, 0.4)]], &[0, 0]);
    check("a corridor beside it", &[whole, [(0.0, 0.7), (8.0, 0.7)]], &[0, 1]);
    check("one half and the whole", &[[(0.0, 0.0), (4.0, 0.0)], whole], &[0, 0]);
    check("two halves", &[[(0.0, 0.0), (4.0, 0.0)], [(4.0, 0.0), (8.0, 0.0)]], &[0, 1]);
    check(
        "two halves, then the whole",
        &[[(0.0, 0.0), (4.0, 0.0)], [(4.0, 0.0), (8.0, 0.0)], whole],
        &[0, 0, 0],
    );
    check("a corner", &[whole, [(8.0, 0.0), (8.0, 8.0)]], &[0, 1]);
    check("short ways that cross", &[[(0.0, 0.0), (3.0, 0.0)], [(1.5, -1.5), (1.5, 1.5)]], &[0, 0]);
    check("long ways that cross", &[whole, [(4.0, -4.0), (4.0, 4.0)]], &[0, 1]);
}

#[test]
fn regions_of_two_kinds_are_two_though_they_are_at_one_place() {
    let there = Trip::straight((0.0, 0.0), (8.0, 0.0), 0);
    let other = Trip::straight((0.0, 0.0), (8.0, 0.0), 1);
    assert_eq!(map(&[there, other], 1.0, 0.5).regions.len(), 2);
}

#[test]
fn a_robot_that_waited_at_one_end_of_a_corridor_was_in_the_corridor() {
    let way = Trip::straight((0.0, 0.0), (8.0, 0.0), 0);
    let mut waited = way.clone();
    waited.poses.extend(vec![at(8.0, 0.0); 1000]);
    let n_frames = waited.poses.len();
    let waited = Trip::through(waited.poses, &vec![0; n_frames]);
    let beyond = Trip::straight((8.0, 0.0), (16.0, 0.0), 0);
    let map = map(&[waited, way, beyond], 1.0, 0.5);
    // Time does not make the end the whole: the next corridor touches it there.
    let regions: Vec<Option<usize>> = map.regions_of_frames.iter().map(|regions| regions[0]).collect();
    assert_eq!(regions, [Some(0), Some(0), Some(1)]);
}

#[test]
fn trips_without_places_of_one_frame_or_of_one_kind_have_maps_too() {
    let empty = map(&[], 1.0, 0.5);
    assert!(empty.regions.is_empty() && empty.edges.is_empty() && empty.regions_of_frames.is_empty());
    let nowhere = map(&[Trip::through(vec![None; 3], &[0, 1, 0])], 1.0, 0.5);
    assert!(nowhere.regions.is_empty() && nowhere.edges.is_empty());
    assert_eq!(nowhere.regions_of_frames, [vec![None; 3]]);
    let check = |trip: Trip, kind, n_frames, dwell_s| {
        let map = map(&[trip], 1.0, 0.5);
        let [region] = map.regions[..] else { panic!("{:?}", map.regions) };
        assert_eq!(
            (region.kind, region.n_visits, region.n_frames, region.dwell_s),
            (kind, 1, n_frames, dwell_s)
        );
        assert!(map.edges.is_empty());
    };
    check(Trip::along(&[3.0], &[0]), 0, 1, 0.0);
    check(Trip::along(&[0.0, 10.0, 20.0], &[0, 0, 0]), 0, 3, 2.0);
    // Of a robot that stands still the kind that it saw for longest remains.
    check(Trip::along(&[2.0; 6], &[0, 1, 1, 1, 1, 0]), 1, 6, 5.0);
    // Frames without a place are nowhere, and do not cut a stretch.
    let gap = Trip::through(vec![None, at(0.0, 0.0), None, at(2.0, 0.0), None], &[1, 0, 1, 0, 1]);
    check(gap.clone(), 0, 2, 2.0);
    assert_eq!(map(&[gap], 1.0, 0.5).regions_of_frames, [[None, Some(0), None, Some(0), None]]);
}

#[test]
fn graphml_reads_back_as_what_was_written_with_types_and_units() {
    let map = map(&there_and_back(), 1.0, 0.6);
    let title = "trips <1> & \"2\" > 'it'";
    let text = map.to_graphml(title, &Register::new(2));
    let document = Document::parse(&text).unwrap();
    let keys: BTreeMap<&str, (&str, &str, &str)> = with_tag(&document, "key")
        .map(|key| {
            let attribute = |name| key.attribute(name).unwrap();
            (attribute("id"), (attribute("for"), attribute("attr.name"), attribute("attr.type")))
        })
        .collect();
    let values = |node: roxmltree::Node| -> Vec<String> {
        let data = node.children().filter(|child| child.has_tag_name((GRAPHML, "data")));
        data.map(|data| {
            let (of, name, kind) = keys[data.attribute("key").unwrap()];
            assert_eq!(of, node.tag_name().name());
            format!("{name}:{kind}={}", data.text().unwrap())
        })
        .collect()
    };
    let graph = with_tag(&document, "graph").next().unwrap();
    assert_eq!(graph.attribute("edgedefault"), Some("directed"));
    let title = format!("title:string={title}");
    assert_eq!(values(graph), [title.as_str(), "size_m_min:double=1", "radius_m:double=0.6"]);
    let nodes: Vec<(Option<&str>, String)> =
        with_tag(&document, "node").map(|node| (node.attribute("id"), values(node).join(" "))).collect();
    let rest = "y_m_min:double=0 y_m_max:double=0 dwell_s:double=10";
    let zero = "kind:int=0 x_m:double=1 y_m:double=0 x_m_min:double=0 x_m_max:double=2";
    let one = "kind:int=1 x_m:double=4 y_m:double=0 x_m_min:double=3 x_m_max:double=5";
    assert_eq!(
        nodes,
        [
            (Some("0"), format!("{zero} {rest} n_visits:int=3 n_frames:int=9")),
            (Some("1"), format!("{one} {rest} n_visits:int=2 n_frames:int=8")),
        ]
    );
    let edges: Vec<String> = with_tag(&document, "edge")
        .map(|edge| {
            let end = |name| edge.attribute(name).unwrap();
            format!("{} → {}: {}", end("source"), end("target"), values(edge).join(" "))
        })
        .collect();
    assert_eq!(
        edges,
        [
            "0 → 1: n_visits:int=2 mean_duration_s:double=3.75 mean_forward_m_s:double=0.5 mean_turn_rad_s:double=-1",
            "1 → 0: n_visits:int=1 mean_duration_s:double=5 mean_forward_m_s:double=2.5 mean_turn_rad_s:double=-5",
        ]
    );
}

const GRAPHML: &str = "http://graphml.graphdrawing.org/xmlns";

fn with_tag<'a>(document: &'a Document, tag: &'static str) -> impl Iterator<Item = roxmltree::Node<'a, 'a>> {
    document.descendants().filter(move |node| node.has_tag_name((GRAPHML, tag)))
}

#[test]
fn commands_that_nobody_knows_are_in_no_file() {
    let [_, there] = there_and_back();
    let map = map(&[there], 1.0, 0.6);
    assert_eq!(
        map.to_graphml("trip", &Register::new(2)).matches("edge_mean_forward_m_s").count(),
        1,
        "the key alone"
    );
    assert!(!map.to_dot("trip", &Register::new(2)).contains("forward"));
}

#[test]
fn dot_has_labels_and_places_and_a_title_of_any_letters() {
    let dot = map(&there_and_back(), 1.0, 0.6).to_dot("a \"b\" \\", &Register::new(2));
    assert_eq!(
        dot,
        "digraph \"a \\\"b\\\" \\\\\" {\n  node [shape=circle];\n  \
         0 [label=\"0\\nkind 0\", pos=\"72.0,0.0\", kind=0, x_m=1, y_m=0, x_m_min=0, x_m_max=2, y_m_min=0, y_m_max=0, \
         dwell_s=10, n_visits=3, n_frames=9];\n  \
         1 [label=\"1\\nkind 1\", pos=\"288.0,0.0\", kind=1, x_m=4, y_m=0, x_m_min=3, x_m_max=5, y_m_min=0, y_m_max=0, \
         dwell_s=10, n_visits=2, n_frames=8];\n  \
         0 -> 1 [label=\"2\", n_visits=2, mean_duration_s=3.75, mean_forward_m_s=0.5, mean_turn_rad_s=-1];\n  \
         1 -> 0 [label=\"1\", n_visits=1, mean_duration_s=5, mean_forward_m_s=2.5, mean_turn_rad_s=-5];\n}\n"
    );
}

/// A wandering robot: runs of at least two frames, so that no two are of the same size.
///
/// * `n_unplaced` — of eight frames, how many have no place
fn wandering(n_unplaced: u32) -> impl Strategy<Value = Trip> {
    let step = (-0.5..0.5_f64, -0.5..0.5_f64, 0..8_u32);
    let run = (0..3_usize, prop::collection::vec(step, 2..8));
    prop::collection::vec(run, 0..30).prop_map(move |runs| {
        let mut trip = Trip::default();
        let (mut x_m, mut y_m) = (0.0, 0.0);
        for (kind, steps) in runs {
            for (dx_m, dy_m, luck) in steps {
                (x_m, y_m) = (x_m + dx_m, y_m + dy_m);
                trip.seconds.push(0.25 * trip.seconds.len() as f64);
                trip.poses.push(if luck < n_unplaced { None } else { at(x_m, y_m) });
                trip.kinds.push(kind);
            }
        }
        trip
    })
}

/// Which region of one map is which of another, if the maps cut the same frames alike.
fn renumbered(one: &[Option<usize>], other: &[Option<usize>]) -> BTreeMap<usize, usize> {
    let pairs: BTreeSet<(Option<usize>, Option<usize>)> =
        one.iter().copied().zip(other.iter().copied()).collect();
    let known = pairs.iter().filter_map(|(one, other)| Some(((*one)?, (*other)?)));
    let there: BTreeMap<usize, usize> = known.collect();
    let back: BTreeSet<usize> = there.values().copied().collect();
    let n_unplaced = usize::from(pairs.contains(&(None, None)));
    assert_eq!((there.len() + n_unplaced, back.len() + n_unplaced), (pairs.len(), pairs.len()), "{pairs:?}");
    there
}

proptest! {
    #[test]
    fn every_placed_frame_is_in_one_region_times_add_up_and_what_comes_goes(
        trips in prop::collection::vec(wandering(1), 1..4),
    ) {
        let map = map(&trips, 0.8, 0.35);
        let mut dwell_s = 0.0;
        let mut n_begun = vec![0; map.regions.len()];
        let mut n_ended = vec![0; map.regions.len()];
        for (trip, regions) in trips.iter().zip(&map.regions_of_frames) {
            let is_placed: Vec<bool> = trip.poses.iter().map(Option::is_some).collect();
            prop_assert_eq!(regions.iter().map(Option::is_some).collect::<Vec<_>>(), is_placed.clone());
            let placed = || (0..is_placed.len()).filter(|frame| is_placed[*frame]);
            if let Some((first, last)) = placed().next().zip(placed().next_back()) {
                dwell_s += trip.seconds[last] - trip.seconds[first];
                n_begun[regions[first].unwrap()] += 1;
                n_ended[regions[last].unwrap()] += 1;
            }
        }
        let total_s: f64 = map.regions.iter().map(|region| region.dwell_s).sum();
        // As many roundings as visits, each of a part of the time.
        prop_assert!((total_s - dwell_s).abs() <= 1e-12 * (1.0 + dwell_s), "{} s, not {} s", total_s, dwell_s);
        for (index, region) in map.regions.iter().enumerate() {
            let n = |is_end: fn(&Edge, usize) -> bool| {
                map.edges.iter().filter(|edge| is_end(edge, index)).map(|edge| edge.n_visits).sum::<usize>()
            };
            prop_assert_eq!(region.n_visits, n_begun[index] + n(|edge, region| edge.to == region));
            prop_assert_eq!(region.n_visits, n_ended[index] + n(|edge, region| edge.from == region));
            let n_frames = map.regions_of_frames.iter().flatten().filter(|of| **of == Some(index)).count();
            prop_assert_eq!(region.n_frames, n_frames);
        }
        for edge in &map.edges {
            prop_assert_ne!(map.regions[edge.from].kind, map.regions[edge.to].kind);
        }
    }

    #[test]
    fn no_stretch_is_small_unless_it_is_the_whole_trip(trip in wandering(1)) {
        let stretches = stretches::cut(&trip.kinds(), 0.8);
        for stretch in &stretches {
            let (width_m, height_m) = stretch.extent.size_m();
            prop_assert!(stretches.len() == 1 || width_m.hypot(height_m) >= 0.8, "{:?}", stretch);
        }
        for pair in stretches.windows(2) {
            prop_assert!(pair[0].last < pair[1].first && pair[0].kind != pair[1].kind);
        }
    }

    #[test]
    fn the_way_back_has_the_same_regions_and_every_edge_reversed(trip in wandering(0)) {
        let there = map(std::slice::from_ref(&trip), 0.8, 0.35);
        let back = map(&[trip.back()], 0.8, 0.35);
        let reversed: Vec<Option<usize>> = back.regions_of_frames[0].iter().rev().copied().collect();
        let name = renumbered(&there.regions_of_frames[0], &reversed);
        let expected: BTreeSet<_> = there.edges.iter().map(|e| (name[&e.to], name[&e.from], e.n_visits)).collect();
        prop_assert_eq!(edges(&back).into_iter().collect::<BTreeSet<_>>(), expected);
    }

    #[test]
    fn the_order_of_trips_changes_the_numbers_of_regions_alone(
        trips in prop::collection::vec(wandering(1), 3),
    ) {
        let one = map(&trips, 0.8, 0.35);
        let order = [2, 0, 1];
        let other = map(&order.map(|index| trips[index].clone()), 0.8, 0.35);
        let frames: Vec<_> = order.iter().flat_map(|&index| one.regions_of_frames[index].clone()).collect();
        let name = renumbered(&frames, &other.regions_of_frames.concat());
        let mut expected: Vec<_> =
            one.edges.iter().map(|edge| (name[&edge.from], name[&edge.to], edge.n_visits)).collect();
        expected.sort_unstable();
        prop_assert_eq!(edges(&other), expected);
        for (index, region) in one.regions.iter().enumerate() {
            let renamed = other.regions[name[&index]];
            prop_assert_eq!((region.kind, region.extent, region.n_visits, region.n_frames),
                (renamed.kind, renamed.extent, renamed.n_visits, renamed.n_frames));
        }
    }
}
