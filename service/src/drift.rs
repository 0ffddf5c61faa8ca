//! Drift: how far the frames of the last ten minutes are from those that the model was learnt from.
//!
//! * the share of frames that are novel: of every frame, from the first hundred on;
//! * the shares of the kinds: total variation, `½ Σ_j |share_j − α_j|`. Of a short while they say nothing, so chance's part is told
//!   with it. A robot's kinds are taken for draws by α, each kept for a while (the model's persistence): draws that fall on the same kind are not
//!   seen, so c changes of the kind so far speak for `m = c / (1 − Σ_j α_j²)` of them. Over m draws of geometric lengths a share varies by
//!   `2 α (1 − α) / m`, and the mean absolute deviation of a Gaussian gives `Σ_j √(α_j (1 − α_j) / (π m))` in all. Told from ten draws on;
//! * the median half-split error ([`kinds_model::half_split`]), of one frame a second, which suffices for a median and costs what
//!   a projection does. It depends on the place, so that it too is told from ten draws on.
//!
//! Time is cut into slots, and the oldest is forgotten as a whole. Counting allocates nothing.

use kinds_messages::Drift;
use kinds_model::half_split::median;

/// Slots that are remembered: ten minutes.
const N_SLOTS: usize = 60;

/// ns.
const SLOT_NS: u64 = 10_000_000_000;

/// Between two frames whose half-split error is measured, ns: measured are at most as many in a slot as there are seconds, and one.
const MEASURE_NS: u64 = 1_000_000_000;
const N_ERRORS_MAX: usize = (SLOT_NS / MEASURE_NS) as usize + 1;

/// Of fewer, the usual rate of novel frames leaves none or one.
const N_FRAMES_MIN: u64 = 100;

/// Draws of kinds before which their shares are those of the places that the robot happens to be at.
const N_DRAWS_MIN: f64 = 10.0;

/// Median errors of fewer are not told.
const N_ERRORS_MIN: usize = 20;

/// What is remembered of the last ten minutes. Holds all memory that it needs.
pub struct DriftWindow {
    /// α, shape `(n_kinds,)`.
    shares_usual: Vec<f64>,
    novel_usual: f64,
    half_split_usual: Option<f64>,
    slots: Vec<Slot>,
    /// Of probabilities, slot by slot, shape `(N_SLOTS, n_kinds)`.
    sums: Vec<f64>,
    /// Number of the slot that is being filled, since the clock began.
    now: u64,
    last_kind: Option<u32>,
    last_measured_ns: Option<u64>,
    /// Where errors are put in order.
    scratch: Vec<f64>,
}

/// Ten seconds.
#[derive(Clone, Copy, Default)]
struct Slot {
    n_frames: u64,
    n_novel: u64,
    n_changes: u64,
    n_errors: usize,
    errors: [f64; N_ERRORS_MAX],
}

impl DriftWindow {
    /// Begins with no frame.
    ///
    /// * `shares_usual` — α, shape `(n_kinds,)`
    /// * `novel_usual` — share of frames like those learnt from that are called novel
    /// * `half_split_usual` — their median half-split error, where the model has one
    pub fn new(shares_usual: &[f64], novel_usual: f64, half_split_usual: Option<f64>) -> Self {
        Self {
            shares_usual: shares_usual.to_vec(),
            novel_usual,
            half_split_usual,
            slots: vec![Slot::default(); N_SLOTS],
            sums: vec![0.0; N_SLOTS * shares_usual.len()],
            now: 0,
            last_kind: None,
            last_measured_ns: None,
            scratch: Vec::with_capacity(N_SLOTS * N_ERRORS_MAX),
        }
    }

    /// Counts a frame that was classified.
    ///
    /// * `now_ns` — by a clock that never goes back
    /// * `probabilities` — of the frame by itself, shape `(n_kinds,)`
    /// * `kind` — given the frames before it, too
    pub(crate) fn count(&mut self, now_ns: u64, probabilities: &[f64], kind: u32, is_novel: bool) {
        let place = self.advance(now_ns);
        let is_change = self.last_kind.replace(kind).is_some_and(|last| last != kind);
        let slot = &mut self.slots[place];
        slot.n_frames += 1;
        slot.n_novel += u64::from(is_novel);
        slot.n_changes += u64::from(is_change);
        let n_kinds = self.shares_usual.len();
        let sums = &mut self.sums[place * n_kinds..][..n_kinds];
        sums.iter_mut().zip(probabilities).for_each(|(sum, probability)| *sum += probability);
    }

    /// Whether the half-split error of a frame that comes now is to be measured.
    pub(crate) fn is_measured(&self, now_ns: u64) -> bool {
        self.half_split_usual.is_some()
            && self.last_measured_ns.is_none_or(|last| now_ns.saturating_sub(last) >= MEASURE_NS)
    }

    /// Takes the half-split error of a frame for which [`Self::is_measured`].
    pub(crate) fn measure(&mut self, now_ns: u64, error: f64) {
        let place = self.advance(now_ns);
        self.last_measured_ns = Some(now_ns);
        let slot = &mut self.slots[place];
        if slot.n_errors < N_ERRORS_MAX {
            slot.errors[slot.n_errors] = error;
            slot.n_errors += 1;
        }
    }

    /// What there is to say.
    pub(crate) fn drift(&mut self, now_ns: u64) -> Drift {
        self.advance(now_ns);
        let total = |of: fn(&Slot) -> u64| self.slots.iter().map(of).sum::<u64>();
        let n_frames = total(|slot| slot.n_frames);
        let mut drift = Drift { n_frames, novel_usual: self.novel_usual, ..Drift::default() };
        drift.half_split_usual = self.half_split_usual.unwrap_or(f64::NAN);
        if n_frames >= N_FRAMES_MIN {
            drift.novel = total(|slot| slot.n_novel) as f64 / n_frames as f64;
        }
        let share_kept: f64 = self.shares_usual.iter().map(|share| share * share).sum();
        let n_draws = total(|slot| slot.n_changes) as f64 / (1.0 - share_kept);
        // Not a number where there is one kind, of which all is said.
        if n_draws >= N_DRAWS_MIN {
            [drift.total_variation, drift.total_variation_usual] = self.total_variation(n_frames, n_draws);
            drift.half_split = self.half_split().unwrap_or(f64::NAN);
        }
        drift
    }

    /// Between shares and α, and what chance has of it.
    fn total_variation(&self, n_frames: u64, n_draws: f64) -> [f64; 2] {
        let n_kinds = self.shares_usual.len();
        let mut both = [0.0; 2];
        for (kind, usual) in self.shares_usual.iter().enumerate() {
            let share = self.sums[kind..].iter().step_by(n_kinds).sum::<f64>() / n_frames as f64;
            both[0] += 0.5 * (share - usual).abs();
            both[1] += (usual * (1.0 - usual) / (std::f64::consts::PI * n_draws)).sqrt();
        }
        both
    }

    /// The median of the errors that were measured, if these are enough.
    fn half_split(&mut self) -> Option<f64> {
        self.scratch.clear();
        self.slots.iter().for_each(|slot| self.scratch.extend(&slot.errors[..slot.n_errors]));
        (self.scratch.len() >= N_ERRORS_MIN).then(|| median(&mut self.scratch))?
    }

    /// Forgets what is too long ago, and returns the place of the slot for now.
    fn advance(&mut self, now_ns: u64) -> usize {
        let (before, n_kinds) = (self.now, self.shares_usual.len());
        self.now = before.max(now_ns / SLOT_NS);
        let place = |number: u64| (number % N_SLOTS as u64) as usize;
        // Once round, and all are forgotten.
        for number in (before + 1..=self.now).take(N_SLOTS) {
            self.slots[place(number)] = Slot::default();
            self.sums[place(number) * n_kinds..][..n_kinds].fill(0.0);
        }
        place(self.now)
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    const S: u64 = 1_000_000_000;

    fn window() -> DriftWindow {
        DriftWindow::new(&[0.5, 0.3, 0.2], 0.01, Some(0.2))
    }

    /// Counts a frame of a kind, beyond doubt.
    fn count(window: &mut DriftWindow, now_ns: u64, kind: usize, is_novel: bool) {
        let mut probabilities = [0.0; 3];
        probabilities[kind] = 1.0;
        window.count(now_ns, &probabilities, kind as u32, is_novel);
    }

    #[test]
    fn novelty_is_told_from_the_hundredth_frame_on_and_ten_minutes_are_remembered() {
        let mut window = window();
        for frame in 0..99 {
            count(&mut window, frame * S / 10, 0, frame % 10 == 0);
        }
        assert!(window.drift(10 * S).novel.is_nan());
        count(&mut window, 10 * S, 0, false);
        let drift = window.drift(11 * S);
        assert_eq!((drift.n_frames, drift.novel, drift.novel_usual), (100, 0.1, 0.01));
        // Of the first ten seconds is nothing left when the slot is used again.
        assert_eq!(window.drift(599 * S).n_frames, 100);
        assert_eq!(window.drift(600 * S).n_frames, 1);
        let forgotten = window.drift(610 * S);
        assert!(forgotten.n_frames == 0 && forgotten.novel.is_nan());
        // Days later, and back at once.
        count(&mut window, 1_000_000 * S, 1, true);
        count(&mut window, 999_999 * S, 1, true);
        assert_eq!(window.drift(1_000_000 * S).n_frames, 2);
    }

    #[test]
    fn shares_are_told_when_the_kind_has_changed_often_enough() {
        let mut window = window();
        // Changes of kinds with these shares speak for 1 / .62 draws each: six of them for less than ten, seven for more.
        for turn in 0..7 {
            (0..20).for_each(|_| count(&mut window, turn * S, turn as usize % 2, false));
        }
        let drift = window.drift(7 * S);
        assert!(drift.total_variation.is_nan() && drift.total_variation_usual.is_nan());
        (0..20).for_each(|_| count(&mut window, 8 * S, 1, false));
        let drift = window.drift(9 * S);
        // Half and half, where .5, .3 and .2 are usual.
        assert!((drift.total_variation - 0.2).abs() < 1e-12, "{drift:?}");
        let chance: f64 = [0.25, 0.21, 0.16]
            .iter()
            .map(|variance| f64::sqrt(variance / (std::f64::consts::PI * 7.0 / 0.62)))
            .sum();
        assert!((drift.total_variation_usual - chance).abs() < 1e-12, "{drift:?}");
    }

    #[test]
    fn of_kinds_as_they_were_learnt_shares_differ_as_much_as_chance_is_said_to_make_them() {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let mut sums = [0.0; 2];
        const N_TRIPS: usize = 400;
        for _ in 0..N_TRIPS {
            let mut window = window();
            let mut kind = 0;
            for frame in 0..3000 {
                if random.random_bool(0.02) {
                    let drawn: f64 = random.random();
                    kind = if drawn < 0.5 { 0 } else { 1 + usize::from(drawn >= 0.8) };
                }
                count(&mut window, frame * S / 6, kind, false);
            }
            let drift = window.drift(500 * S);
            sums[0] += drift.total_variation;
            sums[1] += drift.total_variation_usual;
        }
        // Sixty draws of each trip: the mean over 400 has an error of a twentieth at most (three deviations of about .04 / √400).
        assert!((sums[0] / sums[1] - 1.0).abs() < 0.1, "{} and {}", sums[0] / 400.0, sums[1] / 400.0);
    }

    #[test]
    fn half_split_errors_are_of_one_frame_a_second_and_told_as_their_median() {
        let mut window = window();
        let mut n_measured = 0;
        for frame in 0..300_u64 {
            let now_ns = frame * S / 10;
            count(&mut window, now_ns, frame as usize / 20 % 2, false);
            if window.is_measured(now_ns) {
                // In an order that is not theirs: 0, 7, 14, … of 30.
                window.measure(now_ns, (n_measured * 7 % 30) as f64);
                n_measured += 1;
            }
            let drift = window.drift(now_ns);
            assert_eq!(drift.half_split.is_nan(), n_measured < N_ERRORS_MIN, "{drift:?}");
        }
        let drift = window.drift(30 * S);
        assert_eq!((n_measured, drift.half_split, drift.half_split_usual), (30, 15.0, 0.2));
        let without = DriftWindow::new(&[0.5, 0.5], 0.01, None);
        assert!(!without.is_measured(0));
    }

    #[test]
    fn of_a_model_with_one_kind_shares_say_nothing() {
        let mut window = DriftWindow::new(&[1.0], 0.01, None);
        (0..200).for_each(|_| window.count(0, &[1.0], 0, false));
        let drift = window.drift(0);
        assert!(drift.total_variation.is_nan() && drift.half_split_usual.is_nan() && drift.novel == 0.0);
    }
}
