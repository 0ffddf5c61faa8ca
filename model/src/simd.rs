//! Runs a loop with the widest instructions that the processor has.
//!
//! The loops are plain Rust, written so that the compiler turns them into vector instructions, and are compiled once for
//! each set: so there is one source to read, and what the sets compute is the same by construction. Integers do not depend
//! on how they are grouped, and floating-point numbers are added in the order that the source has (the compiler fuses and
//! reorders nothing that it is not told to).
#![allow(
    unsafe_code,
    reason = "a function that is compiled for instructions which not every processor has may only be called where it has them"
)]

/// A set of instructions that this processor has: there are values of no other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Instructions(Set);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Set {
    /// What every processor of this kind has: SSE2, NEON.
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl Instructions {
    /// What every processor of this kind has.
    #[cfg(test)]
    const PORTABLE: Self = Self(Set::Portable);

    /// The widest. Asks the processor once in the program's life.
    pub(crate) fn widest() -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            if has_avx512() {
                return Self(Set::Avx512);
            }
            if is_x86_feature_detected!("avx2") {
                return Self(Set::Avx2);
            }
        }
        Self(Set::Portable)
    }

    /// All sets that this processor has.
    #[cfg(test)]
    pub(crate) fn all() -> Vec<Self> {
        let mut all = vec![Self::PORTABLE];
        #[cfg(target_arch = "x86_64")]
        {
            all.extend(is_x86_feature_detected!("avx2").then_some(Self(Set::Avx2)));
            all.extend(has_avx512().then_some(Self(Set::Avx512)));
        }
        all
    }

    /// Runs a loop compiled for these instructions. The closure and whatever it calls must be `#[inline(always)]`: what is not
    /// inlined is compiled for the portable ones, and gives the same later.
    #[inline(always)]
    pub(crate) fn run<T>(self, work: impl FnOnce() -> T) -> T {
        match self.0 {
            Set::Portable => work(),
            // SAFETY: values of `Instructions` are made in `widest` and `all` only, there only of sets that the processor was
            // found to have, and a processor does not lose them. That is all that calling these functions asks for: they take
            // and give what any other function does.
            #[cfg(target_arch = "x86_64")]
            Set::Avx2 => unsafe { with_avx2(work) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Set::Avx512 => unsafe { with_avx512(work) },
        }
    }
}

/// All of AVX-512 that [`with_avx512`] is compiled for.
#[cfg(target_arch = "x86_64")]
fn has_avx512() -> bool {
    is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512bw")
        && is_x86_feature_detected!("avx512dq")
        && is_x86_feature_detected!("avx512vl")
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn with_avx2<T>(work: impl FnOnce() -> T) -> T {
    work()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl")]
fn with_avx512<T>(work: impl FnOnce() -> T) -> T {
    work()
}
