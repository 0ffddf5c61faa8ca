//! Bytes that come from outside: the committed corpus of the fuzz targets, what is left of it after a few wrong bytes, and
//! bytes made by chance. Never a panic, never much more memory than they warrant, and always words.
//!
//! Calls the very functions that the fuzz targets call. Alone in its program, since the allocator counts for all tests of one.

use std::path::{Path, PathBuf};
use std::sync::Mutex;

use peak_alloc::PeakAlloc;
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::Index;

#[path = "../../fuzz/src/targets.rs"]
mod targets;

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

/// Only one at a time is measured.
static MEASURED: Mutex<()> = Mutex::new(());

/// What readers hold whatever they read: their own buffers, and a chunk's decompressor.
const HELD_ANYWAY: usize = 16 << 20;
/// Most bytes held for each byte read: what is compressed becomes more, and text becomes trees.
const HELD_PER_BYTE: usize = 300;

type Target = fn(&[u8]) -> Result<(), String>;

const TARGETS: [(&str, Target); 5] = [
    ("model", targets::model),
    ("bag", targets::bag),
    ("wreck", targets::wreck),
    ("ron", targets::ron),
    ("message", targets::message),
];

/// Calls a target, and asserts how much it holds and that it refuses in words. Returns whether it took the bytes.
fn is_taken(target: Target, bytes: &[u8]) -> bool {
    let _alone = MEASURED.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    ALLOCATOR.reset_peak_usage();
    let before = ALLOCATOR.current_usage();
    let outcome = target(bytes);
    let held = ALLOCATOR.peak_usage().saturating_sub(before);
    let limit = HELD_ANYWAY + HELD_PER_BYTE * bytes.len();
    assert!(held <= limit, "{held} bytes held for {} read: {outcome:?}", bytes.len());
    match outcome {
        Ok(()) => true,
        Err(words) => {
            // They may quote what they refuse.
            let most = 10_000 + 4 * bytes.len();
            assert!(words.contains(' ') && words.len() < most, "{} bytes of words: {words:?}", words.len());
            false
        }
    }
}

fn corpus(name: &str) -> Vec<(PathBuf, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus").join(name);
    let mut paths: Vec<_> = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.sort_unstable();
    paths.into_iter().map(|path| (path.clone(), std::fs::read(path).unwrap())).collect()
}

#[test]
fn the_corpus_is_taken_where_it_is_whole_and_refused_in_words_where_it_is_damaged() {
    for (name, target) in TARGETS {
        let mut n_taken = 0;
        for (path, bytes) in corpus(name) {
            let is_whole = path.file_name().unwrap().to_string_lossy().starts_with("whole");
            assert_eq!(is_taken(target, &bytes), is_whole, "{}", path.display());
            n_taken += usize::from(is_whole);
        }
        assert!(n_taken > 0 && n_taken < corpus(name).len(), "{name}: both sorts are there");
    }
}

/// A few changes: a byte becomes another, a stretch goes, comes twice, or is what lengths are made of.
fn damage(bytes: &mut Vec<u8>, changes: &[(u8, Index, Index, u8)]) {
    for &(how, at, to, byte) in changes {
        if bytes.is_empty() {
            return;
        }
        let (at, to) = (at.index(bytes.len()), to.index(bytes.len()));
        let stretch = at.min(to)..at.max(to);
        match how {
            0 => bytes[at] = byte,
            1 => drop(bytes.drain(stretch)),
            2 => bytes.extend_from_within(stretch),
            3 => bytes.truncate(at),
            _ => bytes.iter_mut().skip(at).take(8).for_each(|changed| *changed = byte),
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn bytes_made_by_chance_are_refused_or_harmless(bytes in vec(any::<u8>(), 0..2000)) {
        for (_, target) in TARGETS {
            is_taken(target, &bytes);
        }
    }

    #[test]
    fn whole_files_with_a_few_wrong_bytes_are_refused_or_harmless(
        which in any::<Index>(),
        changes in vec((0..5_u8, any::<Index>(), any::<Index>(), prop_oneof![any::<u8>(), Just(0), Just(255)]), 1..6),
    ) {
        for (name, target) in TARGETS {
            let corpus = corpus(name);
            let (_, mut bytes) = corpus[which.index(corpus.len())].clone();
            damage(&mut bytes, &changes);
            is_taken(target, &bytes);
        }
    }
}
