//! What the service says about one frame: layout version 3, the same for every language.

use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;

use crate::level::Level;

/// Most kinds that a report holds.
pub const MAX_KINDS: usize = 64;
/// Most coordinates that a report holds.
pub const MAX_DIMS: usize = 32;

/// What became of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReportStatus {
    /// The probabilities are the model's answer to this frame.
    Classified,
    /// The frame told nothing; probabilities are finite and sum to 1, but are no answer to it.
    Invalid,
}

impl ReportStatus {
    /// Its name in tables and for scripts.
    pub fn name(self) -> &'static str {
        match self {
            Self::Classified => "classified",
            Self::Invalid => "invalid",
        }
    }

    /// What a number in a message means. One that this version does not know counts as invalid.
    pub(crate) fn of(status: u32) -> Self {
        match status {
            KindReport::CLASSIFIED => Self::Classified,
            _ => Self::Invalid,
        }
    }
}

/// Kind probabilities of one frame, with all that is needed to tell which frame, by which model and how fast.
// Fixed size, no pointers, no padding; offsets are asserted below, and stand in `consumers/layout.csv` for all languages. Words
// here are the C header's too. In Rust probabilities and coordinates are read through methods, which trust no length that a
// faulty writer might have left; C is not given such a report (`is_sound`).
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[repr(C)]
#[type_name("natural_kinds::KindReport")]
pub struct KindReport {
    /// `VERSION` of the program that wrote this.
    pub version: u32,
    /// `CLASSIFIED`, or anything else for a frame that told nothing.
    pub status: u32,
    /// The most probable kind of the frame by itself: its index in `probabilities`, counted from 0. What people call it by is its
    /// number.
    pub kind: u32,
    /// The most probable kind given all frames of the run so far, as its index: changes less often than `kind`.
    pub filtered_kind: u32,
    /// How many kinds the model has: the first so many probabilities are set.
    n_kinds: u32,
    /// How many dimensions the model has: the first so many coordinates are set.
    n_dims: u32,
    /// Readings of the frame without measurement.
    pub n_invalid: u32,
    /// How many frames of the run the filtered probabilities rest on, this one included; 1 after a start or another model.
    pub n_filtered: u32,
    /// The frame's run: start of the driver shim that published it, ns since the epoch.
    pub run: u64,
    /// The frame's number within its run.
    pub sequence: u64,
    /// Frames of this run that the service missed just before this one.
    pub n_lost: u64,
    /// When the sensor captured the frame, ns since the epoch.
    pub captured_ns: i64,
    /// When the driver shim sent the frame, ns on CLOCK_MONOTONIC.
    pub sent_monotonic_ns: u64,
    /// When the service received the frame.
    pub received_monotonic_ns: u64,
    /// When the service sent this report. Set by sending.
    pub reported_monotonic_ns: u64,
    /// Identity of the model: the first bytes of its digest.
    pub model_id: [u8; 16],
    /// ln p(frame) under the mixture; NaN when invalid.
    pub log_likelihood: f64,
    /// From 0, like the frames the model was trained on, to 1, unlike any of them.
    pub novelty: f64,
    /// Probability of each kind, of the frame by itself.
    probabilities: [f64; MAX_KINDS],
    /// Probability of each kind given all frames of the run so far.
    filtered: [f64; MAX_KINDS],
    /// Place of the frame in the embedding.
    coordinates: [f64; MAX_DIMS],
    /// Number of each kind: its own for ever, where its index may be another one's in the next model.
    numbers: [u32; MAX_KINDS],
    /// Which kinds are most alike: `n_kinds` − 1 pairs of indices, in the order in which they come together. The second of a pair,
    /// and all that have joined it, join the first.
    merges: [[u8; 2]; MAX_KINDS],
}

const _: () = {
    use std::mem::{offset_of, size_of};
    assert!(offset_of!(KindReport, version) == 0);
    assert!(offset_of!(KindReport, status) == 4);
    assert!(offset_of!(KindReport, kind) == 8);
    assert!(offset_of!(KindReport, filtered_kind) == 12);
    assert!(offset_of!(KindReport, n_kinds) == 16);
    assert!(offset_of!(KindReport, n_dims) == 20);
    assert!(offset_of!(KindReport, n_invalid) == 24);
    assert!(offset_of!(KindReport, n_filtered) == 28);
    assert!(offset_of!(KindReport, run) == 32);
    assert!(offset_of!(KindReport, sequence) == 40);
    assert!(offset_of!(KindReport, n_lost) == 48);
    assert!(offset_of!(KindReport, captured_ns) == 56);
    assert!(offset_of!(KindReport, sent_monotonic_ns) == 64);
    assert!(offset_of!(KindReport, received_monotonic_ns) == 72);
    assert!(offset_of!(KindReport, reported_monotonic_ns) == 80);
    assert!(offset_of!(KindReport, model_id) == 88);
    assert!(offset_of!(KindReport, log_likelihood) == 104);
    assert!(offset_of!(KindReport, novelty) == 112);
    assert!(offset_of!(KindReport, probabilities) == 120);
    assert!(offset_of!(KindReport, filtered) == 632);
    assert!(offset_of!(KindReport, coordinates) == 1144);
    assert!(offset_of!(KindReport, numbers) == 1400);
    assert!(offset_of!(KindReport, merges) == 1656);
    assert!(size_of::<KindReport>() == 1784);
};

impl KindReport {
    /// Version of this layout. Readers refuse reports of any other.
    pub const VERSION: u32 = 3;
    /// `status` of a frame that was classified.
    pub const CLASSIFIED: u32 = 0;
    /// `status` of a frame that told nothing.
    pub const INVALID: u32 = 1;

    /// What became of the frame. A status that this version does not know counts as invalid.
    pub fn status(&self) -> ReportStatus {
        ReportStatus::of(self.status)
    }

    /// Whether kind and lengths are within the report, so that who indexes by them stays inside it.
    pub fn is_sound(&self) -> bool {
        (self.kind as usize) < MAX_KINDS
            && (self.filtered_kind as usize) < MAX_KINDS
            && self.n_kinds as usize <= MAX_KINDS
            && self.n_dims as usize <= MAX_DIMS
    }

    /// Reports between the last one that came and this one that never came, without frames that never reached the service; none
    /// between two runs.
    pub fn n_missed_since(&self, last: &Self) -> u64 {
        match self.run == last.run {
            true => self.sequence.saturating_sub(last.sequence).saturating_sub(1).saturating_sub(self.n_lost),
            false => 0,
        }
    }

    /// Probability of each kind, of the frame by itself, `(n_kinds,)`.
    pub fn probabilities(&self) -> &[f64] {
        &self.probabilities[..(self.n_kinds as usize).min(MAX_KINDS)]
    }

    /// Probability of each kind given all frames of the run so far, `(n_kinds,)`.
    pub fn filtered(&self) -> &[f64] {
        &self.filtered[..(self.n_kinds as usize).min(MAX_KINDS)]
    }

    /// Place of the frame in the embedding, `(n_dims,)`.
    pub fn coordinates(&self) -> &[f64] {
        &self.coordinates[..(self.n_dims as usize).min(MAX_DIMS)]
    }

    /// Number of each kind, `(n_kinds,)`: its own for ever, while indices are those of one model.
    pub fn numbers(&self) -> &[u32] {
        &self.numbers[..(self.n_kinds as usize).min(MAX_KINDS)]
    }

    /// The number of the kind with an index; of one that there is not, the index.
    pub fn number(&self, kind: u32) -> u32 {
        self.numbers().get(kind as usize).copied().unwrap_or(kind)
    }

    /// The kinds with those most alike taken together until `n_kinds` are left.
    ///
    /// * `n_kinds` — fewer than 1 are taken for 1, and more than the model has for as many
    pub fn at_level(&self, n_kinds: usize) -> Level {
        Level::new(&self.merges, n_kinds, self.probabilities(), self.filtered())
    }

    /// Sets what follows from the model alone: its kinds' numbers, and which are most alike. Panics beyond [`MAX_KINDS`]: no model
    /// has more.
    pub fn set_kinds(
        &mut self,
        numbers: impl ExactSizeIterator<Item = u32>,
        merges: impl Iterator<Item = (usize, usize)>,
    ) {
        (self.numbers, self.merges) = ([0; MAX_KINDS], [[0; 2]; MAX_KINDS]);
        self.n_kinds = numbers.len() as u32;
        numbers.enumerate().for_each(|(kind, number)| self.numbers[kind] = number);
        merges.enumerate().for_each(|(index, (into, from))| self.merges[index] = [into as u8, from as u8]);
    }

    /// Sets the probabilities of the frame by itself, those given all frames so far, and their number. Panics beyond
    /// [`MAX_KINDS`]: no model has more; and if one has more than the other.
    pub fn set_probabilities(&mut self, probabilities: &[f64], filtered: &[f64]) {
        assert_eq!(probabilities.len(), filtered.len(), "both are of the same kinds");
        self.probabilities[..probabilities.len()].copy_from_slice(probabilities);
        self.filtered[..filtered.len()].copy_from_slice(filtered);
        self.n_kinds = probabilities.len() as u32;
    }

    /// Sets the coordinates and their number. Panics beyond [`MAX_DIMS`]: no model has more.
    pub fn set_coordinates(&mut self, coordinates: &[f64]) {
        self.coordinates[..coordinates.len()].copy_from_slice(coordinates);
        self.n_dims = coordinates.len() as u32;
    }
}

/// A report of this version that says nothing: invalid, of no model, without probabilities.
impl Default for KindReport {
    fn default() -> Self {
        Self {
            version: Self::VERSION,
            status: Self::INVALID,
            kind: 0,
            filtered_kind: 0,
            n_kinds: 0,
            n_dims: 0,
            n_invalid: 0,
            n_filtered: 0,
            run: 0,
            sequence: 0,
            n_lost: 0,
            captured_ns: 0,
            sent_monotonic_ns: 0,
            received_monotonic_ns: 0,
            reported_monotonic_ns: 0,
            model_id: [0; 16],
            log_likelihood: f64::NAN,
            novelty: 0.0,
            probabilities: [0.0; MAX_KINDS],
            filtered: [0.0; MAX_KINDS],
            coordinates: [0.0; MAX_DIMS],
            numbers: [0; MAX_KINDS],
            merges: [[0; 2]; MAX_KINDS],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::assert_layout;

    #[test]
    fn layout_is_the_one_that_other_languages_see() {
        assert_layout!(
            "kinds_report",
            KindReport,
            [
                version,
                status,
                kind,
                filtered_kind,
                n_kinds,
                n_dims,
                n_invalid,
                n_filtered,
                run,
                sequence,
                n_lost,
                captured_ns,
                sent_monotonic_ns,
                received_monotonic_ns,
                reported_monotonic_ns,
                model_id,
                log_likelihood,
                novelty,
                probabilities,
                filtered,
                coordinates,
                numbers,
                merges
            ]
        );
    }

    #[test]
    fn probabilities_and_coordinates_come_back_as_they_were_set() {
        let mut report = KindReport::default();
        report.set_probabilities(&[0.25, 0.75], &[0.5, 0.5]);
        report.set_coordinates(&[1.0, -2.0, 3.0]);
        assert_eq!((report.probabilities(), report.filtered()), (&[0.25, 0.75][..], &[0.5, 0.5][..]));
        assert_eq!(report.coordinates(), [1.0, -2.0, 3.0]);
    }

    #[test]
    fn a_kind_has_its_number_and_one_that_there_is_not_its_index() {
        let mut report = KindReport::default();
        report.set_kinds([0, 5].into_iter(), [(0, 1)].into_iter());
        report.set_probabilities(&[0.25, 0.75], &[0.5, 0.5]);
        assert_eq!((report.numbers(), report.number(1), report.number(2)), (&[0, 5][..], 5, 2));
        // Another model's leave nothing behind.
        report.set_kinds([3].into_iter(), [].into_iter());
        let mut only = KindReport::default();
        only.set_kinds([3].into_iter(), [].into_iter());
        assert_eq!((report.numbers, report.merges), (only.numbers, only.merges));
    }

    #[test]
    fn lengths_of_a_faulty_writer_are_clamped() {
        let report = KindReport { n_kinds: u32::MAX, n_dims: 33, ..KindReport::default() };
        assert_eq!((report.probabilities().len(), report.filtered().len()), (MAX_KINDS, MAX_KINDS));
        assert_eq!(report.coordinates().len(), MAX_DIMS);
        assert!(!report.is_sound());
        assert!(KindReport { n_kinds: 64, n_dims: 32, kind: 63, ..KindReport::default() }.is_sound());
        assert!(!KindReport { kind: 64, ..KindReport::default() }.is_sound());
        assert!(!KindReport { filtered_kind: 64, ..KindReport::default() }.is_sound());
    }

    #[test]
    fn reports_are_missed_only_where_neither_run_nor_lost_frames_explain_the_gap() {
        let report = |run, sequence, n_lost| KindReport { run, sequence, n_lost, ..KindReport::default() };
        assert_eq!(report(1, 5, 0).n_missed_since(&report(1, 4, 0)), 0);
        assert_eq!(report(1, 9, 1).n_missed_since(&report(1, 4, 0)), 3);
        assert_eq!(report(1, 9, 4).n_missed_since(&report(1, 4, 0)), 0);
        assert_eq!(report(2, 7, 0).n_missed_since(&report(1, 400, 0)), 0);
    }

    #[test]
    fn unknown_status_counts_as_invalid() {
        for (status, expected) in
            [(0, ReportStatus::Classified), (1, ReportStatus::Invalid), (7, ReportStatus::Invalid)]
        {
            assert_eq!(KindReport { status, ..KindReport::default() }.status(), expected);
        }
    }
}
