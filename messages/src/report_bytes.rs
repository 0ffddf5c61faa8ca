//! A report as bytes, for ways that are no shared memory.
//!
//! The bytes are the report as it lies in memory: little-endian, as all that we run on. What comes as bytes may be anything;
//! it is a report when version, length, kind and lengths are as they should be.

use crate::{KindReport, MAX_DIMS, MAX_KINDS};

/// Why bytes are no report that this program reads.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ForeignReport {
    /// Of another layout.
    #[error(
        "they are of layout version {found}, this program reads version {expected}; run all programs in the same version"
    )]
    OtherVersion {
        /// The report's version.
        found: u32,
        /// Ours.
        expected: u32,
    },
    /// Not as many bytes as a report has.
    #[error("they have {found} bytes, a report has {expected}; run all programs in the same version")]
    OtherLength {
        /// Bytes that came.
        found: usize,
        /// Bytes of a report.
        expected: usize,
    },
    /// A kind, or a number of kinds or dimensions, that no report has room for.
    #[error(
        "they speak of more than the {MAX_KINDS} kinds and {MAX_DIMS} dimensions that a report has room for"
    )]
    Unsound,
}

impl KindReport {
    /// The report as bytes.
    pub fn as_bytes(&self) -> &[u8] {
        bytemuck::bytes_of(self)
    }

    /// The report that these bytes are.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, ForeignReport> {
        let other_length = ForeignReport::OtherLength { found: bytes.len(), expected: size_of::<Self>() };
        // First the version, which stands first in every one: another version's length means nothing.
        let Some((version, _)) = bytes.split_first_chunk() else { return Err(other_length) };
        let found = u32::from_ne_bytes(*version);
        if found != Self::VERSION {
            return Err(ForeignReport::OtherVersion { found, expected: Self::VERSION });
        }
        let report: Self = bytemuck::try_pod_read_unaligned(bytes).map_err(|_| other_length)?;
        if report.is_sound() { Ok(report) } else { Err(ForeignReport::Unsound) }
    }
}

#[cfg(test)]
mod tests {
    use proptest::collection::vec;
    use proptest::prelude::*;

    use super::*;

    fn report() -> KindReport {
        let mut report = KindReport::default();
        (report.run, report.sequence, report.kind) = (3, 7, 1);
        report.set_probabilities(&[0.25, 0.75], &[0.5, 0.5]);
        report.set_coordinates(&[1.0, -2.0]);
        report
    }

    #[test]
    fn a_report_comes_back_from_its_bytes_bit_for_bit_wherever_they_lie() {
        let bytes = [&[0], report().as_bytes()].concat();
        let back = KindReport::from_bytes(&bytes[1..]).unwrap();
        assert_eq!(back.as_bytes(), report().as_bytes());
        assert_eq!(back.probabilities(), [0.25, 0.75]);
    }

    proptest! {
        #[test]
        fn whatever_bytes_come_a_report_of_them_is_within_its_bounds(
            bytes in vec(prop_oneof![3 => Just(0), 1 => any::<u8>()], size_of::<KindReport>()),
            n_bytes in prop_oneof![3 => Just(size_of::<KindReport>()), 1 => 0..size_of::<KindReport>()],
        ) {
            let mut bytes = bytes;
            bytes[..4].copy_from_slice(&KindReport::VERSION.to_ne_bytes());
            if let Ok(report) = KindReport::from_bytes(&bytes[..n_bytes]) {
                prop_assert!((report.kind as usize) < MAX_KINDS && (report.filtered_kind as usize) < MAX_KINDS);
                prop_assert!(report.probabilities().len() <= MAX_KINDS && report.coordinates().len() <= MAX_DIMS);
            }
        }
    }

    #[test]
    fn what_is_no_report_of_ours_is_refused_in_words() {
        let length = size_of::<KindReport>();
        let (ours, next) = (KindReport::VERSION, KindReport::VERSION + 1);
        let (mut other, mut unsound) = (report(), report());
        other.version = next;
        unsound.kind = 64;
        for (bytes, words) in [
            (
                &[][..],
                format!("they have 0 bytes, a report has {length}; run all programs in the same version"),
            ),
            (
                &report().as_bytes()[1..],
                format!(
                    "they are of layout version {}, this program reads version {ours}; run all programs in the same version",
                    u32::from_ne_bytes(report().as_bytes()[1..5].try_into().unwrap())
                ),
            ),
            (
                &report().as_bytes()[..100],
                format!("they have 100 bytes, a report has {length}; run all programs in the same version"),
            ),
            (
                other.as_bytes(),
                format!(
                    "they are of layout version {next}, this program reads version {ours}; run all programs in the same version"
                ),
            ),
            (
                unsound.as_bytes(),
                "they speak of more than the 64 kinds and 32 dimensions that a report has room for"
                    .to_string(),
            ),
        ] {
            assert_eq!(KindReport::from_bytes(bytes).unwrap_err().to_string(), words);
        }
    }
}
