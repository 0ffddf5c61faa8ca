//! Planted policies: which kinds are found aliased, and how that is told.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use super::*;

/// One trip: kind 0 in visits, between which the robot is in kind 1 for `n_between` frames and drives about at random.
struct Planted {
    seconds: Vec<f64>,
    commands: Vec<Option<Command>>,
    kinds: Vec<usize>,
}

impl Planted {
    fn of(visits: &[Vec<[f64; 2]>], n_between: usize) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(99);
        let mut between = move || [random.random_range(-1.5..1.5), random.random_range(-1.5..1.5)];
        let (mut commands, mut kinds) = (Vec::new(), Vec::new());
        for visit in visits {
            commands.extend(visit.iter().copied());
            commands.extend((0..n_between).map(|_| between()));
            kinds.extend(vec![0; visit.len()]);
            kinds.extend(vec![1; n_between]);
        }
        let seconds = (0..kinds.len()).map(|frame| frame as f64 / 5.0).collect();
        Self { seconds, commands: commands.into_iter().map(command).collect(), kinds }
    }

    fn trip(&self) -> TripKinds<'_> {
        let Self { seconds, commands, kinds } = self;
        TripKinds { title: "trip", seconds, poses: &[], commands, kinds }
    }

    fn policy(&self, seed: u64) -> Policy {
        Policy::of(&[self.trip()], 2, seed)
    }
}

fn command([forward_m_s, turn_rad_s]: [f64; 2]) -> Option<Command> {
    Some(Command { forward_m_s, turn_rad_s })
}

/// Box & Muller 1958.
fn normal(random: &mut ChaCha8Rng) -> f64 {
    let (u, v): (f64, f64) = (random.random_range(1e-12..1.0), random.random_range(0.0..1.0));
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

/// Draws one command.
type Draw = fn(&mut ChaCha8Rng) -> [f64; 2];

const UNIMODAL: [(&str, Draw); 9] = [
    ("gaussian", |r| [normal(r), normal(r)]),
    ("gaussian, correlated", |r| {
        let (a, b) = (normal(r), normal(r));
        [a, 0.9 * a + 0.3 * b]
    }),
    ("skewed", |r| [0.3 * normal(r), -r.random_range(1e-9..1.0_f64).ln()]),
    ("even", |r| [r.random_range(-1.0..1.0), r.random_range(-1.0..1.0)]),
    ("even turns at one speed", |r| [0.5, r.random_range(-1.0..1.0)]),
    // Student's t with 3 degrees of freedom.
    ("heavy-tailed", |r| {
        let scale = ((0..3).map(|_| normal(r).powi(2)).sum::<f64>() / 3.0).sqrt();
        [normal(r) / scale, normal(r) / scale]
    }),
    ("one command", |_| [0.5, 0.0]),
    ("a constant with rare corrections left and right", |r| {
        [0.5, [-1.0, 1.0].get(r.random_range(0..25)).copied().unwrap_or(0.0)]
    }),
    ("a stick with steps", |r| [0.5, (4.0 * normal(r)).round() / 4.0]),
];

const BIMODAL: [(&str, Draw); 5] = [
    ("left or right", |r| [0.5 + 0.1 * normal(r), side(r, 2) + 0.2 * normal(r)]),
    ("left or, one time in four, right", |r| [0.5 + 0.1 * normal(r), side(r, 4) + 0.2 * normal(r)]),
    ("two keys", |r| [0.5, side(r, 2)]),
    ("stop or go", |r| [if r.random_range(0..3) == 0 { 0.0 } else { 1.0 }, 0.0]),
    ("six deviations apart", |r| [normal(r), 3.0 * side(r, 2) + normal(r)]),
];

/// −1, or once in `n` draws 1.
fn side(random: &mut ChaCha8Rng, n: usize) -> f64 {
    if random.random_range(0..n) == 0 { 1.0 } else { -1.0 }
}

/// Visits of two frames in which each frame's command is a draw of its own.
fn drawn(draw: Draw, n_visits: usize, seed: u64) -> Vec<Vec<[f64; 2]>> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    (0..n_visits).map(|_| vec![draw(&mut random), draw(&mut random)]).collect()
}

/// Visits of twenty frames, each with a command of its own that is held but for the trembling of a hand.
fn held(draw: Draw, n_visits: usize, seed: u64) -> Vec<Vec<[f64; 2]>> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut visit = || {
        let [forward, turn] = draw(&mut random);
        (0..20).map(|_| [forward + 0.02 * normal(&mut random), turn + 0.02 * normal(&mut random)]).collect()
    };
    (0..n_visits).map(|_| visit()).collect()
}

const N_SEEDS: u64 = 10;

/// For how many seeds kind 0 is found aliased.
fn n_aliased(visits: impl Fn(u64) -> Vec<Vec<[f64; 2]>>) -> u64 {
    let is_aliased = |seed: &u64| Planted::of(&visits(*seed), 10).policy(*seed).kinds[0].is_aliased();
    (0..N_SEEDS).filter(is_aliased).count() as u64
}

#[test]
fn commands_of_one_sort_are_hardly_ever_taken_for_two_whatever_their_shape() {
    for (name, draw) in UNIMODAL {
        // Of few draws no shape can be told; of many all can. Between them chance may leave a gap, once in all ten seeds.
        for (n_visits, n_mistakes) in [(8, 0), (50, 1), (400, 0)] {
            let found = n_aliased(|seed| drawn(draw, n_visits, seed));
            assert!(found <= n_mistakes, "{name}, drawn on {n_visits} visits: {found}");
        }
        for (n_visits, n_mistakes) in [(8, 0), (50, 1), (150, 0)] {
            let found = n_aliased(|seed| held(draw, n_visits, seed));
            assert!(found <= n_mistakes, "{name}, held on {n_visits} visits: {found}");
        }
    }
}

#[test]
fn commands_of_two_sorts_are_always_found() {
    for (name, draw) in BIMODAL {
        assert_eq!(n_aliased(|seed| drawn(draw, 100, seed)), N_SEEDS, "{name}, drawn");
        assert_eq!(n_aliased(|seed| held(draw, 100, seed)), N_SEEDS, "{name}, held");
    }
}

#[test]
fn few_frames_are_no_evidence() {
    for visits in [vec![], vec![vec![[0.5, 1.0]]], vec![vec![[0.5, 1.0]], vec![[0.5, -1.0]]]] {
        assert!(!Planted::of(&visits, 10).policy(0).kinds[0].is_aliased(), "{visits:?}");
    }
}

/// Half a second left, half a second right, over and over.
fn weaving(n_times: usize) -> Vec<[f64; 2]> {
    (0..n_times).flat_map(|_| [vec![[0.5, 1.0]; 8], vec![[0.5, -1.0]; 8]].concat()).collect()
}

#[test]
fn what_was_done_once_is_no_ambiguity_and_what_comes_back_is_within_one_visit_too() {
    let (left, right) = (vec![[0.5, 1.0]; 40], vec![[0.5, -1.0]; 40]);
    let is_aliased = |visits: &[Vec<[f64; 2]>]| Planted::of(visits, 20).policy(0).kinds[0].is_aliased();
    let times = |n_times: usize, visit: &Vec<[f64; 2]>| vec![visit.clone(); n_times];
    let often = vec![[left.clone(), right.clone()]; 12].concat();
    assert!(is_aliased(&often));
    assert!(is_aliased(&[weaving(24)]));
    // Right turns for as long as there were left ones, but all at one time.
    let once: Vec<[f64; 2]> = right.repeat(12);
    assert!(!is_aliased(&[times(12, &left), vec![once.clone()]].concat()), "right once");
    // Here the kind flickers meanwhile: one event still.
    let flickering =
        Planted::of(&[times(12, &left), once.chunks(20).map(<[_]>::to_vec).collect()].concat(), 2);
    assert!(!flickering.policy(0).kinds[0].is_aliased());
}

/// Left for eight frames and right for six, in turn, twenty times.
fn left_and_right() -> Vec<Vec<[f64; 2]>> {
    vec![[vec![[0.5, 1.0]; 8], vec![[0.25, -1.0]; 6]]; 20].concat()
}

#[test]
fn the_two_sorts_are_told_with_shares_means_and_when_they_show() {
    let planted = Planted::of(&left_and_right(), 6);
    let policy = planted.policy(0);
    assert_eq!(policy.aliased().map(|kind| kind.kind).collect::<Vec<_>>(), [0]);
    let [left, right] = &policy.kinds[0].modes[..] else { panic!("two sorts") };
    let counted = (left.n_frames, left.share, right.n_frames, right.share);
    assert_eq!(counted, (160, 160.0 / 280.0, 120, 120.0 / 280.0));
    assert_eq!((left.command.forward_m_s, left.command.turn_rad_s), (0.5, 1.0));
    assert!((right.command.turn_rad_s + 1.0).abs() < 1e-12);
    let spell = |from_s, to_s, first_frame_index, last_frame_index, n_frames| Spell {
        trip: "trip".to_string(),
        from_s,
        to_s,
        first_frame_index,
        last_frame_index,
        n_frames,
    };
    assert_eq!(left.spells[..2], [spell(0.0, 1.6, 0, 7, 8), spell(5.2, 6.8, 26, 33, 8)]);
    assert_eq!(right.spells[..2], [spell(2.8, 4.0, 14, 19, 6), spell(8.0, 9.2, 40, 45, 6)]);
    assert_eq!((left.spells.len(), right.spells.len()), (20, 20));
    assert_eq!(policy.modes[0][7..15], [&[Some(0)][..], &[None; 6], &[Some(1)]].concat());
}

#[test]
fn means_and_covariances_are_those_computed_by_hand() {
    let commands = [[1.0, 0.0], [3.0, 2.0], [2.0, 4.0], [2.0, 2.0]].map(|both| command(both).unwrap());
    let spread = CommandSpread::of(&commands).unwrap();
    // From the means 2 and 2: (−1, −2), (1, 0), (0, 2) and (0, 0).
    let expected = CommandSpread { forward_m_s: 2.0, turn_rad_s: 2.0, covariance: [[0.5, 0.5], [0.5, 2.0]] };
    assert_eq!(spread, expected);
    assert_eq!(spread.deviations(), [0.5_f64.sqrt(), 2.0_f64.sqrt()]);
    assert_eq!(CommandSpread::of(&[]), None);
}

#[test]
fn frames_without_a_command_are_counted_and_say_nothing() {
    let commands = [command([1.0, 0.0]), None, command([3.0, 0.0]), None];
    let trip = TripKinds {
        title: "trip",
        seconds: &[0.0, 1.0, 2.0, 3.0],
        poses: &[],
        commands: &commands,
        kinds: &[0, 0, 0, 1],
    };
    let policy = Policy::of(&[trip, trip], 2, 0);
    assert_eq!((policy.n_frames_without_command, policy.kinds[0].n_frames), (4, 4));
    assert_eq!(policy.kinds[0].command.unwrap().forward_m_s, 2.0);
    let nothing =
        KindCommands { kind: 1, n_frames: 0, n_frames_effective: 0.0, command: None, modes: vec![] };
    assert_eq!(policy.kinds[1], nothing);
    assert!(policy.has_commands());
    assert!(!Policy::of(&[TripKinds { commands: &[None; 4], ..trip }], 2, 0).has_commands());
}

#[test]
fn the_table_reads_back_and_says_its_units() {
    let policy = Policy::of(&[Planted::of(&left_and_right(), 6).trip()], 3, 0);
    let numbers = "(kinds: [(number: 1, name: \"\", note: \"\"), (number: 4, name: \"\", note: \"\"), \
                   (number: 6, name: \"\", note: \"\")], retired: [])";
    let register: Register = ron::from_str(numbers).unwrap();
    let text = policy.to_ron("3f2a\"91", &register);
    let table: PolicyTable = ron::from_str(&text).unwrap();
    assert_eq!(table, policy.table("3f2a\"91", &register));
    assert_eq!(table.kinds.iter().map(|kind| kind.kind).collect::<Vec<_>>(), [1, 4, 6]);
    assert!(table.kinds[0].aliased && table.kinds[0].modes.len() == 2);
    assert_eq!((table.kinds[2].command, table.kinds[2].n_frames), (None, 0));
    assert!(text.starts_with("// A first-pass policy") && text.contains("(m/s)") && text.contains("(rad/s)"));
    // Whoever has no RON at hand reads lines.
    assert!(text.lines().all(|line| line.chars().count() <= 240), "{text}");
}
