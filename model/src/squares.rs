//! Sums of squared differences of counts: what a distance between two frames is made of.
//!
//! The plain version is [`plain`]. Departures from it:
//! 1. Differences are taken in 16 bits and their squares in two halves of 16 bits each, as vector instructions have them:
//!    thirty-two readings to an instruction instead of eight.
//! 2. The halves are summed by themselves in 32 bits, and widened once for a span of readings.
//! 3. Several frames are measured side by side. They lie far apart in memory, and a processor fetches several streams sooner
//!    together than one after the other: of 19840 readings, eight frames that are not in a cache take half the time.

use bytemuck::cast;

use crate::simd::Instructions;

/// Readings that are taken at once.
const N_LANES: usize = 32;

/// Most readings before sums are widened: each lane then has `N_SPAN / N_LANES` pairs of halves below 2¹⁶, and their sum is
/// below 2³².
const N_SPAN: usize = 1 << 19;
const _: () = assert!((N_SPAN / N_LANES * 2) as u64 * (u16::MAX as u64) < 1 << 32);

/// `Σ (a_i − b_i)²` of one frame and each of several others of its length. Exact.
pub(crate) fn sums<const R: usize>(from: &[u16], to: [&[u16]; R]) -> [u64; R] {
    sums_with(Instructions::widest(), from, to)
}

/// The same in the plainest way. For few readings, sooner.
pub(crate) fn plain(a: &[u16], b: &[u16]) -> u64 {
    each(a, b).sum()
}

/// Squared differences, one by one.
pub(crate) fn each(a: &[u16], b: &[u16]) -> impl Iterator<Item = u64> {
    debug_assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(&a, &b)| {
        let difference = u32::from(a.abs_diff(b));
        // 65535² is below 2³².
        u64::from(difference * difference)
    })
}

fn sums_with<const R: usize>(instructions: Instructions, from: &[u16], to: [&[u16]; R]) -> [u64; R] {
    let mut sums = [0; R];
    let mut begin = 0;
    while begin < from.len() {
        let end = from.len().min(begin + N_SPAN);
        let (from, to) = (&from[begin..end], to.map(|to| &to[begin..end]));
        let of_span = instructions.run(
            #[inline(always)]
            || of_span(from, to),
        );
        sums.iter_mut().zip(of_span).for_each(|(sum, of_span)| *sum += of_span);
        begin = end;
    }
    sums
}

#[inline(always)]
fn of_span<const R: usize>(from: &[u16], to: [&[u16]; R]) -> [u64; R] {
    let (blocks, rest) = from.as_chunks::<N_LANES>();
    let to = to.map(|to| to.as_chunks::<N_LANES>());
    let others = to.map(|(others, _)| &others[..blocks.len()]);
    // Each lane is a pair of neighbouring readings.
    let mut lows = [[0_u32; N_LANES / 2]; R];
    let mut highs = [[0_u32; N_LANES / 2]; R];
    for (index, block) in blocks.iter().enumerate() {
        for row in 0..R {
            let other = &others[row][index];
            let mut low = [0_u16; N_LANES];
            let mut high = [0_u16; N_LANES];
            for lane in 0..N_LANES {
                let difference = block[lane].abs_diff(other[lane]);
                low[lane] = difference.wrapping_mul(difference);
                high[lane] = ((u32::from(difference) * u32::from(difference)) >> 16) as u16;
            }
            let (low, high): ([u32; N_LANES / 2], [u32; N_LANES / 2]) = (cast(low), cast(high));
            for pair in 0..N_LANES / 2 {
                lows[row][pair] += (low[pair] & 0xffff) + (low[pair] >> 16);
                highs[row][pair] += (high[pair] & 0xffff) + (high[pair] >> 16);
            }
        }
    }
    let total = |lanes: &[u32; N_LANES / 2]| lanes.iter().map(|&lane| u64::from(lane)).sum::<u64>();
    std::array::from_fn(|row| total(&lows[row]) + (total(&highs[row]) << 16) + plain(rest, to[row].1))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn every_set_of_instructions_gives_the_plain_sums(
            frames in (0..200_usize).prop_flat_map(|n_readings| {
                let reading = prop_oneof![0..4_u16, Just(u16::MAX), any::<u16>()];
                prop::array::uniform4(prop::collection::vec(reading, n_readings))
            }),
        ) {
            let [from, a, b, c] = &frames;
            let expected = [a, b, c].map(|to| plain(from, to));
            for instructions in Instructions::all() {
                prop_assert_eq!(sums_with(instructions, from, [a, b, c]), expected, "{:?}", instructions);
                prop_assert_eq!(sums_with(instructions, from, [b]), [expected[1]], "{:?}", instructions);
            }
        }
    }

    #[test]
    fn the_greatest_differences_of_more_readings_than_a_span_has_do_not_overflow() {
        let n_readings = 2 * N_SPAN + 77;
        let (black, white) = (vec![0; n_readings], vec![u16::MAX; n_readings]);
        for instructions in Instructions::all() {
            let [sum] = sums_with(instructions, &black, [&white]);
            assert_eq!(sum, n_readings as u64 * 65535 * 65535, "{instructions:?}");
        }
    }
}
