//! Against scikit-learn's numbers, which `tests/golden/make_golden.py` made.

use std::path::Path;

use kinds_trainer::adjusted_mutual_information;
use safetensors::SafeTensors;

#[test]
fn adjusted_mutual_information_is_scikit_learns_also_for_degenerate_labellings() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/agreement.safetensors");
    let bytes = std::fs::read(path).unwrap();
    let tensors = SafeTensors::deserialize(&bytes).unwrap();
    let array = |name: &str| tensors.tensor(&format!("agreement/{name}")).unwrap().data().to_vec();
    let eights = |name: &str| {
        array(name).chunks_exact(8).map(|eight| <[u8; 8]>::try_from(eight).unwrap()).collect::<Vec<_>>()
    };
    let (first, second) = (array("first"), array("second"));
    let offsets: Vec<usize> =
        eights("offsets").into_iter().map(|eight| u64::from_le_bytes(eight) as usize).collect();
    let expected = eights("adjusted_mutual_info").into_iter().map(f64::from_le_bytes);
    let mut n_checked = 0;
    for (range, expected) in offsets.windows(2).zip(expected) {
        let range = range[0]..range[1];
        let labels = first[range.clone()].iter().zip(&second[range.clone()]);
        let pairs: Vec<(usize, usize)> = labels.map(|(&a, &b)| (a.into(), b.into())).collect();
        let found = adjusted_mutual_information(&pairs);
        // Sums of some 1500 logarithms.
        assert!((found - expected).abs() < 1e-11, "pair {n_checked}: {found} instead of {expected}");
        n_checked += 1;
    }
    assert_eq!(n_checked, 49);
}
