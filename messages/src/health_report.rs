//! What a service says about itself once a second: layout version 2, the same for every language.

use iceoryx2::prelude::ZeroCopySend;

use crate::ReportStatus;
use crate::fixed::Message;

/// How long one stage of a frame's way took, over some frames.
///
/// Values are within 1 % of what was measured, and stop at a minute.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ZeroCopySend)]
#[repr(C)]
#[type_name("natural_kinds::Latency")]
pub struct Latency {
    /// Frames that were measured. All else is 0 where there were none.
    pub n_frames: u64,
    /// Of all these frames together, exactly, ns.
    pub sum_ns: u64,
    /// Half of the frames took no longer, ns.
    pub p50_ns: u64,
    /// Nine of ten, ns.
    pub p90_ns: u64,
    /// 99 of 100, ns.
    pub p99_ns: u64,
    /// 999 of 1000, ns.
    pub p999_ns: u64,
    /// The slowest, ns.
    pub max_ns: u64,
}

/// How long each stage took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ZeroCopySend)]
#[repr(C)]
#[type_name("natural_kinds::StageLatencies")]
pub struct StageLatencies {
    /// From the driver shim's sending a frame to the service's receiving it: transport, wake-up, and frames before it.
    pub sent_to_received: Latency,
    /// From there to sending its report: classification.
    pub received_to_reported: Latency,
    /// Both together.
    pub sent_to_reported: Latency,
}

/// How far the frames of the last ten minutes are from those that the model was learnt from. Begins anew with a model.
///
/// What is not known yet is not a number.
#[derive(Clone, Copy, Debug, ZeroCopySend)]
#[repr(C)]
#[type_name("natural_kinds::Drift")]
pub struct Drift {
    /// Frames classified in that time.
    pub n_frames: u64,
    /// Share of them that are novel. Known from the hundredth on.
    pub novel: f64,
    /// The same of frames like those that the model was learnt from.
    pub novel_usual: f64,
    /// Total variation between the kinds' shares of them and in training. Known when the kind has changed often enough.
    pub total_variation: f64,
    /// What chance makes of that, as often as the kind has changed.
    pub total_variation_usual: f64,
    /// How far apart halves of its nearest reference frames place a frame, as a share of the radius of all trained places: the median of
    /// one frame a second. Known as total variation is, where the model has a graph.
    pub half_split: f64,
    /// The same of frames like those that the model was learnt from.
    pub half_split_usual: f64,
}

/// What neither knows is equal, too.
impl PartialEq for Drift {
    fn eq(&self, other: &Self) -> bool {
        let numbers = |drift: &Self| {
            let Self {
                novel,
                novel_usual,
                total_variation,
                total_variation_usual,
                half_split,
                half_split_usual,
                ..
            } = *drift;
            [novel, novel_usual, total_variation, total_variation_usual, half_split, half_split_usual]
        };
        let is_equal = |(a, b): (f64, f64)| a == b || a.is_nan() && b.is_nan();
        self.n_frames == other.n_frames && numbers(self).into_iter().zip(numbers(other)).all(is_equal)
    }
}

/// Nothing is known.
impl Default for Drift {
    fn default() -> Self {
        Self {
            n_frames: 0,
            novel: f64::NAN,
            novel_usual: f64::NAN,
            total_variation: f64::NAN,
            total_variation_usual: f64::NAN,
            half_split: f64::NAN,
            half_split_usual: f64::NAN,
        }
    }
}

/// Counters and latencies of one service since it started, and over the last interval, which is about a second.
///
/// Reports that a slow reader lost are not among them: where a reader's buffer is full the transport drops its oldest, and
/// tells nobody. The reader knows, by gaps in the reports' sequence beyond what they say was lost before.
///
/// Only integers and floats, no padding; offsets are asserted below.
#[derive(Clone, Copy, Debug, PartialEq, ZeroCopySend)]
#[repr(C)]
#[type_name("natural_kinds::HealthReport")]
pub struct HealthReport {
    /// [`HealthReport::VERSION`] of the program that wrote this.
    pub version: u32,
    /// [`HealthReport::HAS_SHIM`] and [`HealthReport::HAS_LAST_FRAME`], or-ed.
    pub flags: u32,
    /// When this was sent, [`monotonic_ns`](crate::monotonic_ns).
    pub sent_monotonic_ns: u64,
    /// Since the service started, ns.
    pub uptime_ns: u64,
    /// Length of the last interval, ns: 0 in the first message.
    pub interval_ns: u64,
    /// Identity of the model in use.
    pub model_id: [u8; 16],
    /// Frames that came. Like all counters below, since the service started.
    pub n_frames: u64,
    /// Of these, classified.
    pub n_classified: u64,
    /// Of these, reported as invalid.
    pub n_invalid: u64,
    /// Of those classified, unlike what the model has seen.
    pub n_novel: u64,
    /// Frames that never came, by the gaps in their sequence.
    pub n_lost: u64,
    /// Frames that came twice or out of order, and were left alone.
    pub n_repeated: u64,
    /// Frames reported so late that the next one was due: longer after they were sent than they were sent after the frame
    /// before.
    pub n_late: u64,
    /// Frames that were not for the model.
    pub n_refused: u64,
    /// Frames without a command, where the model compares commands.
    pub n_uncommanded: u64,
    /// Models taken into use after the first.
    pub n_reloads: u64,
    /// Models that were asked for and refused.
    pub n_reloads_refused: u64,
    /// Programs that were killed and that this service cleaned up after.
    pub n_peers_lost: u64,
    /// Status of the last report. Meaningful with [`HealthReport::HAS_LAST_FRAME`], as all about the last report.
    pub last_status: u32,
    /// Number of the kind of the last report.
    pub last_kind: u32,
    /// Probability of that kind.
    pub last_probability: f64,
    /// Novelty of the last report.
    pub last_novelty: f64,
    /// Latencies over the last interval.
    pub last_interval: StageLatencies,
    /// Latencies since the service started.
    pub since_start: StageLatencies,
    /// Drift over the last ten minutes.
    pub drift: Drift,
}

const _: () = {
    use std::mem::{offset_of, size_of};
    assert!(size_of::<Latency>() == 56);
    assert!(size_of::<StageLatencies>() == 168);
    assert!(offset_of!(StageLatencies, received_to_reported) == 56);
    assert!(offset_of!(StageLatencies, sent_to_reported) == 112);
    assert!(offset_of!(HealthReport, version) == 0);
    assert!(offset_of!(HealthReport, flags) == 4);
    assert!(offset_of!(HealthReport, sent_monotonic_ns) == 8);
    assert!(offset_of!(HealthReport, uptime_ns) == 16);
    assert!(offset_of!(HealthReport, interval_ns) == 24);
    assert!(offset_of!(HealthReport, model_id) == 32);
    assert!(offset_of!(HealthReport, n_frames) == 48);
    assert!(offset_of!(HealthReport, n_classified) == 56);
    assert!(offset_of!(HealthReport, n_invalid) == 64);
    assert!(offset_of!(HealthReport, n_novel) == 72);
    assert!(offset_of!(HealthReport, n_lost) == 80);
    assert!(offset_of!(HealthReport, n_repeated) == 88);
    assert!(offset_of!(HealthReport, n_late) == 96);
    assert!(offset_of!(HealthReport, n_refused) == 104);
    assert!(offset_of!(HealthReport, n_uncommanded) == 112);
    assert!(offset_of!(HealthReport, n_reloads) == 120);
    assert!(offset_of!(HealthReport, n_reloads_refused) == 128);
    assert!(offset_of!(HealthReport, n_peers_lost) == 136);
    assert!(offset_of!(HealthReport, last_status) == 144);
    assert!(offset_of!(HealthReport, last_kind) == 148);
    assert!(offset_of!(HealthReport, last_probability) == 152);
    assert!(offset_of!(HealthReport, last_novelty) == 160);
    assert!(offset_of!(HealthReport, last_interval) == 168);
    assert!(offset_of!(HealthReport, since_start) == 336);
    assert!(offset_of!(HealthReport, drift) == 504);
    assert!(size_of::<HealthReport>() == 560);
    assert!(size_of::<Drift>() == 56);
    assert!(offset_of!(Drift, n_frames) == 0);
    assert!(offset_of!(Drift, novel) == 8);
    assert!(offset_of!(Drift, novel_usual) == 16);
    assert!(offset_of!(Drift, total_variation) == 24);
    assert!(offset_of!(Drift, total_variation_usual) == 32);
    assert!(offset_of!(Drift, half_split) == 40);
    assert!(offset_of!(Drift, half_split_usual) == 48);
};

impl HealthReport {
    /// Version of this layout. Readers refuse any other.
    pub const VERSION: u32 = 2;
    /// A driver shim publishes the sensor.
    pub const HAS_SHIM: u32 = 1;
    /// There was a report, and what is said about the last one is so.
    pub const HAS_LAST_FRAME: u32 = 2;

    /// Whether a driver shim publishes the sensor.
    pub fn has_shim(&self) -> bool {
        self.flags & Self::HAS_SHIM != 0
    }

    /// Status of the last report, if there was one.
    pub fn last_status(&self) -> Option<ReportStatus> {
        (self.flags & Self::HAS_LAST_FRAME != 0).then(|| ReportStatus::of(self.last_status))
    }

    /// Frames reported in a second, over the last interval.
    pub fn rate_hz(&self) -> f64 {
        match self.interval_ns {
            0 => 0.0,
            interval_ns => self.last_interval.sent_to_reported.n_frames as f64 * 1e9 / interval_ns as f64,
        }
    }
}

/// Health of this version of a service that has just started, by no model.
impl Default for HealthReport {
    fn default() -> Self {
        Self {
            version: Self::VERSION,
            flags: 0,
            sent_monotonic_ns: 0,
            uptime_ns: 0,
            interval_ns: 0,
            model_id: [0; 16],
            n_frames: 0,
            n_classified: 0,
            n_invalid: 0,
            n_novel: 0,
            n_lost: 0,
            n_repeated: 0,
            n_late: 0,
            n_refused: 0,
            n_uncommanded: 0,
            n_reloads: 0,
            n_reloads_refused: 0,
            n_peers_lost: 0,
            last_status: 0,
            last_kind: 0,
            last_probability: 0.0,
            last_novelty: 0.0,
            last_interval: StageLatencies::default(),
            since_start: StageLatencies::default(),
            drift: Drift::default(),
        }
    }
}

impl Message for HealthReport {
    const VERSION: u32 = Self::VERSION;

    fn version(&self) -> u32 {
        self.version
    }
}
