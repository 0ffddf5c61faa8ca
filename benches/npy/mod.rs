//! Files of numbers that numpy reads as well.

use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::Path;

/// Bytes of a header; the numbers follow.
const N_HEADER_BYTES: usize = 128;

/// A file that numpy reads, whose numbers are yet to be written (NEP 1, version 1.0).
pub(crate) fn create(path: &Path, number: &str, shape: &[usize]) -> BufWriter<File> {
    let shape: String = shape.iter().map(|n| format!("{n}, ")).collect();
    let header = format!("{{'descr': '{number}', 'fortran_order': False, 'shape': ({shape}), }}");
    let n_after = N_HEADER_BYTES - 10;
    let mut file = BufWriter::new(File::create(path).expect("a file in the data's folder can be made"));
    let mut begin = b"\x93NUMPY\x01\x00".to_vec();
    begin.extend((n_after as u16).to_le_bytes());
    begin.extend(format!("{header:<width$}\n", width = n_after - 1).into_bytes());
    assert_eq!(begin.len(), N_HEADER_BYTES);
    file.write_all(&begin).expect("a header can be written");
    file
}

/// Adds counts.
pub(crate) fn write_counts(file: &mut impl Write, counts: &[u16]) {
    let bytes: Vec<u8> = counts.iter().flat_map(|count| count.to_le_bytes()).collect();
    file.write_all(&bytes).expect("counts can be written");
}

/// The first `n` numbers of a file that [`create`] began.
pub(crate) fn read<T, const BYTES: usize>(path: &Path, n: usize, of_bytes: fn([u8; BYTES]) -> T) -> Vec<T> {
    let mut file = File::open(path).expect("the data was prepared");
    file.seek(SeekFrom::Start(N_HEADER_BYTES as u64)).expect("it has a header");
    let mut file = BufReader::new(file);
    let next = |_| {
        let mut bytes = [0; BYTES];
        file.read_exact(&mut bytes).expect("it has as many numbers");
        of_bytes(bytes)
    };
    (0..n).map(next).collect()
}
