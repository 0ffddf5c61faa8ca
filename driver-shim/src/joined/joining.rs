//! From frames of several sensors, as they come, to joint frames. Knows no channel and no clock: time comes in.

use std::collections::VecDeque;
use std::time::Duration;

use kinds_messages::{FrameHeader, SensorName, Spell};
use kinds_trips::{FrameLayout, Partner, Stamp, counts_in_unit, join};

use super::JoinPlan;
use super::numbering::Numbering;
use crate::{Capture, NumberedFrame};

/// Frames of the leader that wait for others at most; of more the first goes without.
const N_WAITING_MAX: usize = 64;

/// Joint frames for which it is noticed that a partner's frame comes too late.
const N_REMEMBERED: usize = 64;

/// A sensor that is joined, by its first frame.
#[derive(Clone, Debug)]
pub(super) struct Part {
    pub(super) sensor: SensorName,
    pub(super) layout: FrameLayout,
}

/// Joins frames.
pub(super) struct Joining {
    plan: JoinPlan,
    layout: FrameLayout,
    leader: Leader,
    partners: Vec<Companion>,
    /// Frames of the leader, in the order in which they came.
    waiting: VecDeque<Led>,
    /// Buffers of frames that were taken, for the next.
    spare: Vec<Vec<u16>>,
    n_joined: u64,
    news: VecDeque<String>,
}

struct Leader {
    sensor: SensorName,
    /// Its counts in the joint unit, shape `(65536,)`.
    in_unit: Vec<u16>,
    numbering: Numbering,
}

/// A frame of the leader that waits for others.
struct Led {
    frame: NumberedFrame,
    counts: Vec<u16>,
    came: Duration,
}

/// A sensor whose frames go with the leader's.
struct Companion {
    sensor: SensorName,
    in_unit: Vec<u16>,
    frames: Partner,
    /// The last frames of the leader that were joined, and which of ours went with each.
    joined: VecDeque<(Stamp, Option<Stamp>)>,
    /// Joint frames without one of ours.
    missing: Spell,
    /// Frames of ours that came when the leader's that they belong to had been joined.
    late: Spell,
    /// One of ours in the joint unit.
    counts: Vec<u16>,
}

impl Joining {
    /// Joins the frames of these, of which the first leads.
    ///
    /// # Panics
    /// If there are none.
    pub(super) fn new(plan: JoinPlan, parts: &[Part]) -> Self {
        let (leader, partners) = parts.split_first().expect("one leads");
        let metres_per_count = parts.iter().map(|part| part.layout.metres_per_count).fold(0.0, f64::max);
        let n_readings: usize = parts.iter().map(|part| part.layout.n_readings()).sum();
        let in_unit = |part: &Part| counts_in_unit(part.layout.metres_per_count, metres_per_count);
        let companion = |part: &Part| Companion {
            sensor: part.sensor.clone(),
            in_unit: in_unit(part),
            frames: Partner::new(part.layout.n_readings(), plan.tolerance),
            joined: VecDeque::with_capacity(N_REMEMBERED),
            missing: Spell::default(),
            late: Spell::default(),
            counts: Vec::with_capacity(part.layout.n_readings()),
        };
        Self {
            plan,
            layout: FrameLayout { rows: 1, columns: n_readings as u32, metres_per_count },
            leader: Leader {
                sensor: leader.sensor.clone(),
                in_unit: in_unit(leader),
                numbering: Numbering::default(),
            },
            partners: partners.iter().map(companion).collect(),
            waiting: VecDeque::with_capacity(N_WAITING_MAX + 1),
            spare: Vec::with_capacity(N_WAITING_MAX + 1),
            n_joined: 0,
            news: VecDeque::new(),
        }
    }

    /// What joint frames look like: a row with the readings of all, in the coarsest of their units, in which none of their
    /// ranges is too far.
    pub(super) fn layout(&self) -> FrameLayout {
        self.layout
    }

    /// Takes in a frame of the leader.
    pub(super) fn lead(&mut self, header: &FrameHeader, counts: &[u16], now: Duration) {
        let capture = Capture::of(header);
        let sequence = self.leader.numbering.place(header.run, header.sequence);
        let frame = NumberedFrame { capture, sequence, n_readings: self.layout.n_readings() };
        let mut own = self.spare.pop().unwrap_or_default();
        translate(&self.leader.in_unit, counts, &mut own);
        self.waiting.push_back(Led { frame, counts: own, came: now });
    }

    /// Takes in a frame of a partner.
    ///
    /// * `index` — which, the leader apart
    pub(super) fn accompany(&mut self, index: usize, captured: Stamp, counts: &[u16]) {
        let Self { partners, leader, news, .. } = self;
        let companion = &mut partners[index];
        translate(&companion.in_unit, counts, &mut companion.counts);
        companion.frames.insert(captured, &companion.counts);
        let is_late = companion.joined.iter().any(|&(led, taken)| {
            companion.frames.is_near(captured, led) && taken.is_none_or(|taken| taken < captured)
        });
        if is_late && companion.late.count(1) {
            let (partner, leader) = (&companion.sensor, &leader.sensor);
            news.push_back(format!(
                "frames of {partner} come when those of {leader} that they belong to are joined already, with older ones or \
                 none; let {partner} lead, or have joint frames wait for it (--wait-ms)"
            ));
        }
    }

    /// The next joint frame, if it need not or may not wait any longer; `None`: not yet.
    ///
    /// * `counts` — `(n_readings,)`; overwritten
    pub(super) fn next(&mut self, now: Duration, counts: &mut [u16]) -> Option<NumberedFrame> {
        let first = self.waiting.front()?;
        let has_waited = now.saturating_sub(first.came) >= self.plan.wait;
        if !has_waited && self.waiting.len() < N_WAITING_MAX && self.awaited().is_some() {
            return None;
        }
        let Led { frame, counts: own, .. } = self.waiting.pop_front()?;
        let captured = frame.capture.captured;
        counts[..own.len()].copy_from_slice(&own);
        join(captured, own.len(), self.partners.iter().map(|companion| &companion.frames), counts);
        self.spare.push(own);
        for companion in &mut self.partners {
            self.news.extend(companion.account(captured, &self.leader.sensor, self.plan.tolerance));
        }
        self.n_joined += 1;
        Some(frame)
    }

    /// The partner that the first frame waits for, if one waits: which, the leader apart.
    pub(super) fn awaited(&self) -> Option<usize> {
        let captured = self.waiting.front()?.frame.capture.captured;
        self.partners.iter().position(|companion| !companion.frames.reaches(captured))
    }

    /// Has something told after what there is to tell already.
    pub(super) fn tell(&mut self, news: String) {
        self.news.push_back(news);
    }

    pub(super) fn news(&mut self) -> Option<String> {
        self.news.pop_front()
    }

    /// What there is to say of all frames, each a sentence: of each partner that was missing or late.
    pub(super) fn remarks(&self) -> Vec<String> {
        let (leader, n_joined) = (&self.leader.sensor, self.n_joined);
        let of = |companion: &Companion| {
            let (sensor, n_missing, n_late) = (&companion.sensor, companion.missing.n(), companion.late.n());
            (n_missing + n_late > 0).then(|| {
                format!(
                    "of {n_joined} frames of {leader}, {n_missing} were joined without one of {sensor}; {n_late} frames of {sensor} \
                     came too late for those that they belong to"
                )
            })
        };
        self.partners.iter().filter_map(of).collect()
    }
}

impl Companion {
    /// Counts what belonged to a frame of the leader that is joined. Returns what there is to tell.
    fn account(
        &mut self,
        led: Stamp,
        leader: &SensorName,
        tolerance: Duration,
    ) -> impl Iterator<Item = String> + use<> {
        let partner = &self.sensor;
        let taken = self.frames.at(led).map(|(captured, _)| captured);
        if self.joined.len() == N_REMEMBERED {
            self.joined.pop_front();
        }
        self.joined.push_back((led, taken));
        let of_missing = match taken {
            Some(_) => self.missing.calm().map(|n_missing| {
                format!("{partner} has frames at the time of those of {leader} again; {n_missing} were without")
            }),
            None => self.missing.count(1).then(|| {
                let latest = self.frames.latest().map_or(String::new(), |latest| apart(latest, led));
                let what = if self.frames.is_indispensable() { "joint frames are" } else { "its reading is" };
                format!(
                    "{partner} has no frame at the time of those of {leader}, or at most {} ms before{latest}; {what} invalid until it \
                     has",
                    tolerance.as_millis()
                )
            }),
        };
        let of_late = self.late.calm().map(|n_late| {
            format!("frames of {partner} come in time for those of {leader} again; {n_late} came too late")
        });
        of_missing.into_iter().chain(of_late)
    }
}

/// How far the last frame of a partner is from one of the leader, for whose clocks differ, or who is gone.
fn apart(latest: Stamp, led: Stamp) -> String {
    let before_s = led.seconds_since(latest);
    let direction = if before_s < 0.0 { "after" } else { "before" };
    format!(" (its last was captured {:.1} s {direction})", before_s.abs())
}

/// * `in_unit` — what each count is in the other unit, shape `(65536,)`
fn translate(in_unit: &[u16], counts: &[u16], translated: &mut Vec<u16>) {
    translated.clear();
    translated.extend(counts.iter().map(|&count| in_unit[usize::from(count)]));
}

#[cfg(test)]
mod tests {
    use kinds_messages::Pose;
    use proptest::prelude::*;

    use super::*;

    const RING: &str = "crunch/ring";
    const CAMERA: &str = "crunch/camera";

    fn part(sensor: &str, n_readings: u32, metres_per_count: f64) -> Part {
        let layout = FrameLayout { rows: 1, columns: n_readings, metres_per_count };
        Part { sensor: sensor.parse().unwrap(), layout }
    }

    /// A ring of two readings, and a camera of one.
    fn joining(tolerance_ms: u64, wait_ms: u64) -> Joining {
        let plan = JoinPlan { tolerance: ms(tolerance_ms), wait: ms(wait_ms) };
        Joining::new(plan, &[part(RING, 2, 0.001), part(CAMERA, 1, 0.001)])
    }

    fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    fn at(ms: i64) -> Stamp {
        Stamp(ms * 1_000_000)
    }

    fn header(sequence: u64, captured_ms: i64) -> FrameHeader {
        FrameHeader { run: 1, sequence, captured_ns: at(captured_ms).0, ..FrameHeader::default() }
    }

    /// All joint frames that are due: when they were captured, ms, and their counts.
    fn due(joining: &mut Joining, now: Duration) -> Vec<(i64, Vec<u16>)> {
        let mut counts = vec![9; joining.layout().n_readings()];
        std::iter::from_fn(|| {
            let frame = joining.next(now, &mut counts)?;
            Some((frame.capture.captured.0 / 1_000_000, counts.clone()))
        })
        .collect()
    }

    fn told(joining: &mut Joining) -> Vec<String> {
        std::iter::from_fn(|| joining.news()).collect()
    }

    /// Of frames that are 1 ms apart and more, as they come: whose, and when they were captured.
    type Came = Vec<(bool, i64)>;

    /// Any two sensors, each of which sends in order, and which interrupt each other as they like.
    fn any_order() -> impl Strategy<Value = Came> {
        let moments = || prop::collection::btree_set(1_i64..2000, 1..40).prop_map(Vec::from_iter);
        (moments(), moments(), prop::collection::vec(any::<bool>(), 80)).prop_map(|(ring, camera, whose)| {
            let (mut ring, mut camera) = (ring.into_iter(), camera.into_iter());
            let mut came: Came = Vec::new();
            for leads in whose {
                let captured = if leads { ring.next() } else { camera.next() };
                came.extend(captured.map(|captured| (leads, captured)));
            }
            came.extend(ring.map(|captured| (true, captured)));
            came.extend(camera.map(|captured| (false, captured)));
            came
        })
    }

    /// What of the camera belongs to a frame of the ring, by the rule itself.
    fn by_definition(came: &Came, led: i64, tolerance_ms: i64) -> u16 {
        let camera = came.iter().filter(|(leads, _)| !leads).map(|(_, captured)| *captured);
        camera.filter(|own| (led - tolerance_ms..=led).contains(own)).max().unwrap_or(0) as u16
    }

    /// Joins frames as they come, 1 ms after each other. Joint frames, and the end.
    fn join(came: &Came, tolerance_ms: i64, wait_ms: u64) -> (Vec<(i64, Vec<u16>)>, Joining) {
        let mut joining = joining(tolerance_ms as u64, wait_ms);
        let mut joint = Vec::new();
        let mut sequence = 0;
        for (now, &(leads, captured)) in (0..).map(ms).zip(came) {
            let count = captured as u16;
            if leads {
                joining.lead(&header(sequence, captured), &[count, count + 1], now);
                sequence += 1;
            } else {
                joining.accompany(0, at(captured), &[count]);
            }
            joint.extend(due(&mut joining, now));
        }
        joint.extend(due(&mut joining, ms(1_000_000)));
        (joint, joining)
    }

    proptest! {
        #[test]
        fn each_frame_of_the_leader_is_joined_once_and_by_the_rule_unless_one_that_came_late_is_counted(
            came in any_order(),
            tolerance_ms in 0_i64..300,
            wait_ms in 0_u64..40,
        ) {
            let (joint, joining) = join(&came, tolerance_ms, wait_ms);
            let led: Vec<i64> = came.iter().filter(|(leads, _)| *leads).map(|(_, captured)| *captured).collect();
            prop_assert_eq!(joint.iter().map(|(captured, _)| *captured).collect::<Vec<_>>(), led);
            let n_late = joining.partners[0].late.n();
            let n_missing = joint.iter().filter(|(_, counts)| counts[2] == 0).count() as u64;
            prop_assert_eq!(joining.partners[0].missing.n(), n_missing);
            let n_wrong = joint
                .iter()
                .filter(|(led, counts)| counts[2] != by_definition(&came, *led, tolerance_ms))
                .count();
            prop_assert_eq!(n_wrong > 0, n_late > 0, "{} wrong, {} late", n_wrong, n_late);
        }

        #[test]
        fn frames_that_may_wait_are_joined_by_the_rule_in_whatever_order_they_come(
            came in any_order(),
            tolerance_ms in 0_i64..300,
        ) {
            let (joint, joining) = join(&came, tolerance_ms, 1_000_000);
            prop_assert_eq!(joining.partners[0].late.n(), 0);
            for (led, counts) in joint {
                let count = led as u16;
                prop_assert_eq!(counts, [count, count + 1, by_definition(&came, led, tolerance_ms)]);
            }
        }
    }

    #[test]
    fn nothing_waits_unless_it_may() {
        let mut now = joining(100, 0);
        now.accompany(0, at(70), &[7]);
        now.lead(&header(0, 100), &[1, 2], ms(5));
        assert_eq!(due(&mut now, ms(5)), [(100, vec![1, 2, 7])]);

        let mut waiting = joining(100, 20);
        waiting.accompany(0, at(70), &[7]);
        waiting.lead(&header(0, 100), &[1, 2], ms(5));
        waiting.lead(&header(1, 110), &[3, 4], ms(6));
        assert_eq!((due(&mut waiting, ms(24)), waiting.awaited()), (vec![], Some(0)));
        // What is captured with it settles it; the next has to wait for its own.
        waiting.accompany(0, at(100), &[8]);
        assert_eq!(due(&mut waiting, ms(24)), [(100, vec![1, 2, 8])]);
        assert_eq!(due(&mut waiting, ms(26)), [(110, vec![3, 4, 8])]);
        assert_eq!(waiting.awaited(), None);
    }

    #[test]
    fn the_frames_that_wait_are_bounded() {
        let mut joining = joining(100, 1_000_000);
        let mut n_joined = 0;
        for sequence in 0..1000 {
            joining.lead(&header(sequence, sequence as i64), &[1, 2], ms(0));
            n_joined += due(&mut joining, ms(0)).len();
            assert!(joining.waiting.len() < N_WAITING_MAX);
        }
        assert_eq!(n_joined, 1000 - (N_WAITING_MAX - 1));
    }

    #[test]
    fn a_partner_that_is_gone_is_told_once_and_once_more_when_it_is_back() {
        let mut joining = joining(100, 0);
        let frame = |joining: &mut Joining, sequence: i64, with: bool| {
            if with {
                joining.accompany(0, at(100 * sequence), &[5]);
            }
            joining.lead(&header(sequence as u64, 100 * sequence), &[1, 2], ms(0));
            due(joining, ms(0)).remove(0).1[2]
        };
        assert_eq!(frame(&mut joining, 0, true), 5);
        // Still near enough.
        assert_eq!(frame(&mut joining, 1, false), 5);
        assert_eq!(told(&mut joining), [""; 0]);
        for sequence in 2..40 {
            assert_eq!(frame(&mut joining, sequence, false), 0);
        }
        assert_eq!(
            told(&mut joining),
            [
                "crunch/camera has no frame at the time of those of crunch/ring, or at most 100 ms before (its last was captured 0.2 s \
              before); its reading is invalid until it has"
            ]
        );
        for sequence in 40..139 {
            assert_eq!(frame(&mut joining, sequence, true), 5);
        }
        assert_eq!(told(&mut joining), [""; 0]);
        frame(&mut joining, 139, true);
        assert_eq!(
            told(&mut joining),
            ["crunch/camera has frames at the time of those of crunch/ring again; 38 were without"]
        );
        assert_eq!(
            joining.remarks(),
            [
                "of 140 frames of crunch/ring, 38 were joined without one of crunch/camera; 0 frames of crunch/camera came too late for \
              those that they belong to"
            ]
        );
    }

    #[test]
    fn a_clock_that_jumps_is_told_with_how_far_it_is_away() {
        for (jump_ms, words) in [(3_600_000, "3599.7 s after"), (-7000, "7.3 s before")] {
            let mut joining = joining(250, 0);
            joining.accompany(0, at(10_000), &[5]);
            joining.accompany(0, at(10_100 + jump_ms), &[6]);
            joining.lead(&header(0, 10_400), &[1, 2], ms(0));
            assert_eq!(due(&mut joining, ms(0)), [(10_400, vec![1, 2, 0])]);
            let told = told(&mut joining);
            assert!(
                told.len() == 1 && told[0].contains(&format!("(its last was captured {words})")),
                "{told:?}"
            );
        }
    }

    #[test]
    fn frames_that_come_too_late_are_told() {
        let mut joining = joining(250, 0);
        joining.accompany(0, at(0), &[5]);
        for sequence in 1..4 {
            joining.lead(&header(sequence, 100 * sequence as i64), &[1, 2], ms(0));
            due(&mut joining, ms(0));
            joining.accompany(0, at(100 * sequence as i64), &[5]);
        }
        // The same again, and one that belongs to no frame yet.
        joining.accompany(0, at(400), &[5]);
        assert_eq!(
            told(&mut joining),
            [
                "frames of crunch/camera come when those of crunch/ring that they belong to are joined already, with older ones or none; \
              let crunch/camera lead, or have joint frames wait for it (--wait-ms)"
            ]
        );
        assert!(
            joining.remarks()[0]
                .ends_with("3 frames of crunch/camera came too late for those that they belong to")
        );
    }

    #[test]
    fn joint_frames_are_in_the_coarsest_unit_and_keep_what_is_known_of_the_leaders() {
        let plan = JoinPlan::default();
        let parts = [part(RING, 2, 0.00025), part(CAMERA, 1, 0.001), part("crunch/scan", 1, 0.0005)];
        let mut joining = Joining::new(plan, &parts);
        assert_eq!(joining.layout(), FrameLayout { rows: 1, columns: 4, metres_per_count: 0.001 });
        joining.accompany(0, at(90), &[1234]);
        joining.accompany(1, at(95), &[4000]);
        let pose = Pose { x_m: 1.0, y_m: 2.0, yaw_rad: 3.0 };
        let header = FrameHeader { sequence: 5, captured_ns: at(100).0, ..FrameHeader::default() };
        joining.lead(&header.with_pose(Some(pose)), &[4000, 0], ms(0));
        let mut counts = [0; 4];
        let frame = joining.next(ms(0), &mut counts).unwrap();
        assert_eq!(counts, [1000, 0, 1234, 2000]);
        let capture = Capture { captured: at(100), pose: Some(pose), command: None, true_pose: None };
        assert_eq!(frame, NumberedFrame { capture, sequence: 0, n_readings: 4 });
    }

    #[test]
    fn without_a_whole_sensor_all_of_a_joint_frame_is_invalid_and_without_a_single_reading_only_that() {
        let parts = [part(RING, 2, 0.001), part(CAMERA, 2, 0.001), part("crunch/bumper", 1, 0.001)];
        let mut joining = Joining::new(JoinPlan::default(), &parts);
        joining.accompany(0, at(90), &[7, 8]);
        joining.lead(&header(0, 100), &[1, 2], ms(0));
        joining.accompany(1, at(390), &[9]);
        joining.lead(&header(1, 400), &[1, 2], ms(0));
        assert_eq!(due(&mut joining, ms(0)), [(100, vec![1, 2, 7, 8, 0]), (400, vec![0; 5])]);
        let told = told(&mut joining);
        assert!(
            told[0].starts_with("crunch/bumper ")
                && told[0].ends_with("; its reading is invalid until it has")
        );
        assert!(
            told[1].starts_with("crunch/camera ")
                && told[1].ends_with("; joint frames are invalid until it has")
        );
    }
}
