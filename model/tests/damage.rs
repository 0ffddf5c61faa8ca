//! Every byte of a small model's file, damaged in turn: refused in words, or it changes nothing.

use bytes::Bytes;
use kinds_model::{FitPlan, Origin, ResponsePlan, Scale, SensorLayout, file, fit};
use rayon::prelude::*;

/// Of geodesics, so that every array there can be is in it.
fn small_model() -> Vec<u8> {
    let plan = FitPlan {
        n_neighbors: Some(4),
        n_landmarks: 30,
        n_dims: Some(2),
        n_kinds: Some(2),
        ..FitPlan::new(
            SensorLayout { rows: 1, columns: 3, metres_per_count: 0.001 },
            ResponsePlan::new(Scale::Range, 4.0),
            0,
        )
    };
    let counts = (1..91_u32).map(|index| (index * index * 37 % 3001) as u16).collect();
    let origin = Origin { n_frames: vec![12, 18], ..Origin::default() };
    file::to_bytes(&fit(counts, &plan, origin, &mut |_, _, _| ()).unwrap())
}

/// What became of damaged bytes: whether they were refused. Whatever is not refused must be the very same model.
fn is_refused(whole: &[u8], damaged: Vec<u8>, what: &str) -> bool {
    match file::from_bytes(&Bytes::from(damaged)) {
        Ok(model) => {
            assert_eq!(file::to_bytes(&model), whole, "{what} was not noticed");
            false
        }
        Err(error) => {
            assert!(error.to_string().contains(' '), "{what}: {error}");
            true
        }
    }
}

#[test]
fn a_wrong_byte_anywhere_is_refused_or_changes_nothing() {
    let whole = small_model();
    let n_header = 8 + u64::from_le_bytes(whole[..8].try_into().unwrap()) as usize;
    let refuse = |&(index, flip): &(usize, u8)| {
        let mut damaged = whole.clone();
        damaged[index] ^= flip;
        is_refused(&whole, damaged, &format!("byte {index} flipped by {flip}"))
    };
    // One bit of every byte; and in the text before the arrays, where a byte can come to mean much else, three ways more.
    let everywhere = (0..whole.len()).map(|index| (index, 1 << (index % 8)));
    let header = (0..n_header).flat_map(|index| [1, 32, 255].map(|flip| (index, flip)));
    let flips: Vec<_> = everywhere.chain(header).collect();
    let n_refused = flips.par_iter().filter(|flip| refuse(flip)).count();
    assert!(n_refused >= whole.len(), "{n_refused} of {} refused", flips.len());
}

#[test]
fn a_model_cut_off_anywhere_is_refused() {
    let whole = small_model();
    let all_but = (0..whole.len()).into_par_iter().step_by(7).chain(whole.len() - 64..whole.len());
    all_but.for_each(|n_bytes| {
        assert!(is_refused(&whole, whole[..n_bytes].to_vec(), "a cut"), "{n_bytes} of {} bytes", whole.len());
    });
}
