//! Recordings that end too early, or have a wrong byte: at every byte there is.

use std::path::Path;

use kinds_trips::{Command, Compression, Pose, Scan, Selection, Stamp, TripError, TripWriter, WriterOptions};

use crate::bag::{Bag, Folder, LASER_SCAN, Read, read, read_whole, refusal, scan};

pub(crate) const N_FRAMES: u16 = 5;

/// A small trip; about two messages in a chunk.
fn write_small(path: &Path, compression: Compression, chunk_bytes: Option<u64>, indexed: bool) {
    let options = WriterOptions { compression, chunk_bytes, indexed };
    let mut writer = TripWriter::create(path, &options).unwrap();
    for index in 0..N_FRAMES {
        let at = Stamp(1_000_000_000 * i64::from(index + 1));
        let scan = Scan {
            counts: &[1000 + index, 2000 + index, 0],
            metres_per_count: 0.001,
            bearing_rad_min: 0.0,
            bearing_step_rad: 0.5,
            range_m_min: 0.05,
            range_m_max: 4.0,
        };
        writer.write_scan("/scan", at, &scan).unwrap();
        if index == 2 {
            writer.write_odometry("/odom", at, &Pose { x_m: 1.0, y_m: 2.0, yaw_rad: 3.0 }).unwrap();
            writer.write_command("/cmd_vel", at, &Command { forward_m_s: 1.0, turn_rad_s: 2.0 }).unwrap();
        }
    }
    writer.finish().unwrap();
}

/// A small trip without checksums, as recorders make them whose first aim is speed.
pub(crate) fn write_unchecked(path: &Path, chunked: bool) {
    let options = mcap::WriteOptions::new()
        .compression(None)
        .use_chunks(chunked)
        .chunk_size(Some(200))
        .calculate_chunk_crcs(false)
        .calculate_data_section_crc(false)
        .calculate_summary_section_crc(false);
    let mut bag = Bag::with_options(path, options);
    let id = bag.topic("/scan", LASER_SCAN);
    for index in 0..u32::from(N_FRAMES) {
        bag.message(id, u64::from(index), &scan((1000, index), &[1.0, 2.0]));
    }
    bag.finish();
}

/// The small trip in every layout that a file can have, as bytes.
pub(crate) fn layouts(folder: &Folder) -> Vec<Vec<u8>> {
    let path = folder.join("whole.mcap");
    let mut layouts = Vec::new();
    for (compression, chunk_bytes) in [
        (Compression::None, None),
        (Compression::None, Some(300)),
        (Compression::Lz4, Some(300)),
        (Compression::Zstd, Some(300)),
    ] {
        for indexed in [true, false] {
            write_small(&path, compression, chunk_bytes, indexed);
            assert_eq!(read_whole(&path).frames.len(), usize::from(N_FRAMES));
            layouts.push(std::fs::read(&path).unwrap());
        }
    }
    layouts
}

/// Frames' times and counts; poses and commands depend on what comes later.
fn content(read: &Read) -> Vec<(Stamp, &[u16])> {
    read.frames.iter().map(|(info, counts)| (info.captured, counts.as_slice())).collect()
}

#[test]
fn a_trip_cut_off_at_any_byte_gives_the_frames_before_and_says_so() {
    let folder = Folder::new();
    for whole_bytes in layouts(&folder) {
        let whole = read_whole(&folder.write("whole.mcap", &whole_bytes));
        let mut n_frames_before = 0;
        for n_bytes in 0..whole_bytes.len() {
            match read(&folder.write("cut.mcap", &whole_bytes[..n_bytes])) {
                Ok(trip) => {
                    assert!(trip.failure.is_none(), "{n_bytes}: {:?}", trip.failure);
                    assert!(content(&whole).starts_with(&content(&trip)), "{n_bytes}");
                    let truncation = trip.truncation.expect("a trip that was cut off says so");
                    assert_eq!(
                        (truncation.n_bytes, truncation.n_frames),
                        (n_bytes as u64, trip.frames.len() as u64)
                    );
                    assert!(truncation.at_byte <= n_bytes as u64);
                    assert!(!truncation.data_is_whole || trip.frames.len() == whole.frames.len());
                    assert!(trip.frames.len() >= n_frames_before, "more bytes give no fewer frames");
                    n_frames_before = trip.frames.len();
                }
                Err(TripError::Empty { .. }) => assert_eq!(n_bytes, 0),
                Err(TripError::CutOffBeforeFirstFrame { n_bytes: told, at_byte, .. }) => {
                    assert_eq!((told, n_frames_before), (n_bytes as u64, 0));
                    assert!(at_byte <= told, "{at_byte} of {told}");
                }
                Err(error) => panic!("{n_bytes}: {error}"),
            }
        }
        assert_eq!(n_frames_before, usize::from(N_FRAMES), "all but the last byte give all frames");
    }
}

#[test]
fn a_ros_1_bag_that_ends_within_its_first_line_is_cut_off_there() {
    let folder = Folder::new();
    for n_bytes in 1..=b"#ROSBAG V2.0\n".len() {
        let error = read(&folder.write("cut.bag", &b"#ROSBAG V2.0\n"[..n_bytes])).err().unwrap();
        let TripError::CutOffBeforeFirstFrame { at_byte, n_bytes: told, .. } = error else {
            panic!("{error}")
        };
        assert_eq!((at_byte, told), (n_bytes as u64, n_bytes as u64));
    }
}

#[test]
fn the_end_of_a_cut_off_trip_is_told_in_a_sentence() {
    let folder = Folder::new();
    let path = folder.join("trip.mcap");
    write_unchecked(&path, false);
    let whole = std::fs::read(&path).unwrap();
    let told = |n_bytes: usize| {
        std::fs::write(&path, &whole[..n_bytes]).unwrap();
        read(&path).unwrap().truncation.unwrap().to_string()
    };
    let n_bytes = whole.len();
    // Magic, header, schema and channel, then messages of 9 + 22 bytes and their data.
    let header = 9 + 4 + 4 + mcap::LIBRARY_IDENTIFIER.len();
    let schema = 9 + 2 + 4 + LASER_SCAN.len() + 4 + "ros2msg".len() + 4;
    let channel = 9 + 2 + 2 + 4 + "/scan".len() + 4 + "cdr".len() + 4;
    let message = 9 + 22 + scan((1000, 0), &[1.0, 2.0]).len();
    let third = 8 + header + schema + channel + 2 * message;
    assert_eq!(
        told(third + 20),
        format!("is cut off at byte {third} of {}; the 2 frames before that were read", third + 20)
    );
    let data_end = third + 3 * message + 9 + 4;
    assert_eq!(
        told(n_bytes - 1),
        format!(
            "is not properly closed after byte {data_end} of {}; all its 5 frames were read",
            n_bytes - 1
        )
    );
    std::fs::write(&path, &whole[..third - 2 * message]).unwrap();
    let first = third - 2 * message;
    assert_eq!(
        refusal(&path, &Selection::default()),
        format!("{} is cut off at byte {first} of {first}, before its first frame", path.display())
    );
}

#[test]
fn an_end_that_the_file_system_filled_with_zeroes_is_cut_off() {
    let folder = Folder::new();
    let path = folder.join("trip.mcap");
    write_small(&path, Compression::Zstd, Some(300), true);
    let whole = std::fs::read(&path).unwrap();
    let n_frames = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        let trip = read(&path).unwrap();
        assert!(trip.failure.is_none(), "{:?}", trip.failure);
        assert_eq!(trip.truncation.unwrap().n_frames, trip.frames.len() as u64);
        trip.frames.len()
    };
    let chunk_ends: Vec<usize> = chunk_ends(&whole);
    let [.., second_to_last, last] = chunk_ends[..] else { panic!("several chunks") };
    // After the last whole chunk; and within the last chunk, whose length alone reached the disk.
    let mut zeroes_after = whole[..second_to_last].to_vec();
    zeroes_after.resize(second_to_last + 5000, 0);
    let mut zeroes_within = whole[..last - 30].to_vec();
    zeroes_within.resize(last, 0);
    let before = n_frames(&zeroes_after);
    assert!(before > 0 && before < usize::from(N_FRAMES));
    assert_eq!(n_frames(&zeroes_within), before);
}

#[test]
fn a_wrong_byte_anywhere_is_an_error_or_changes_nothing() {
    let folder = Folder::new();
    for whole_bytes in layouts(&folder) {
        let whole = read_whole(&folder.write("whole.mcap", &whole_bytes));
        for (index, flip) in flips(&whole_bytes) {
            let Ok(trip) = read_flipped(&folder, &whole_bytes, index, flip) else { continue };
            if trip.failure.is_none() {
                // Nobody complained, so all is well, to the bit.
                assert_eq!(trip.frames, whole.frames, "byte {index} ^ {flip:#x}");
            }
        }
    }
}

#[test]
fn a_wrong_byte_in_a_trip_without_checksums_never_stops_the_reader() {
    let folder = Folder::new();
    let path = folder.join("whole.mcap");
    for chunked in [true, false] {
        write_unchecked(&path, chunked);
        let whole_bytes = std::fs::read(&path).unwrap();
        for (index, flip) in flips(&whole_bytes) {
            if let Ok(trip) = read_flipped(&folder, &whole_bytes, index, flip) {
                assert!(trip.frames.len() <= usize::from(N_FRAMES), "byte {index} ^ {flip:#x}");
            }
        }
    }
}

#[test]
fn damage_in_the_middle_is_told_with_its_place() {
    let folder = Folder::new();
    let path = folder.join("trip.mcap");
    let check = |damage: &dyn Fn(&mut Vec<u8>), expected: &str| {
        write_small(&path, Compression::None, Some(300), true);
        let mut bytes = std::fs::read(&path).unwrap();
        damage(&mut bytes);
        std::fs::write(&path, &bytes).unwrap();
        let sentence = match read(&path) {
            Ok(trip) => trip.failure.expect("damage is an error").to_string(),
            Err(error) => error.to_string(),
        };
        let [first_end, ..] = chunk_ends(&bytes)[..] else { panic!("several chunks") };
        let expected = expected
            .replace("TRIP", &path.display().to_string())
            .replace("SECOND", &first_end.to_string())
            .replace("FIRST", &(8 + first_record_bytes(&bytes)).to_string());
        let masked = without_numbers(&sentence);
        assert_eq!(masked, without_numbers(&expected));
    };
    // The last byte of the first chunk.
    check(
        &|bytes| {
            let end = chunk_ends(bytes)[0];
            bytes[end - 1] ^= 1;
        },
        "TRIP is damaged at byte FIRST: a chunk's checksum should be 00000000 and is 00000000",
    );
    // The length of the first chunk: three bytes too short for what it holds, then far too long.
    check(
        &|bytes| {
            let first = 8 + first_record_bytes(bytes);
            bytes[first + 1] ^= 3;
        },
        "TRIP is damaged at byte FIRST: a chunk is shorter than what it says it holds",
    );
    check(
        &|bytes| {
            let first = 8 + first_record_bytes(bytes);
            bytes[first + 7] = 1;
        },
        "TRIP is damaged at byte FIRST: the record there claims more bytes than the file has left",
    );
    // The opcode of the first chunk.
    check(
        &|bytes| {
            let first = 8 + first_record_bytes(bytes);
            bytes[first] = 0;
        },
        "TRIP is damaged at byte FIRST: what stands there is no record",
    );
    // What the first chunk says that it holds.
    let uncompressed_bytes = 9 + 16;
    check(
        &|bytes| {
            let first = 8 + first_record_bytes(bytes);
            bytes[first + uncompressed_bytes + 4] = 1;
        },
        "TRIP has a chunk or record of CHUNK bytes at byte FIRST, more than the 268435456 that are read at once; record it \
         with smaller chunks",
    );
    check(
        &|bytes| {
            let first = 8 + first_record_bytes(bytes);
            bytes[first + uncompressed_bytes + 2] = 1;
        },
        "TRIP is damaged at byte FIRST: a chunk should hold EXPECTED bytes and holds FOUND or more",
    );
}

#[test]
fn a_checksum_of_all_data_is_held_against_them() {
    let folder = Folder::new();
    let path = folder.join("trip.mcap");
    write_small(&path, Compression::None, None, true);
    let mut bytes = std::fs::read(&path).unwrap();
    // A reading of the second frame, 1.001 m.
    let reading = bytes.windows(4).position(|window| window == 1.001f32.to_le_bytes()).unwrap();
    bytes[reading] ^= 1;
    std::fs::write(&path, &bytes).unwrap();
    let trip = read(&path).unwrap();
    assert_eq!(trip.frames.len(), usize::from(N_FRAMES));
    let sentence = trip.failure.unwrap().to_string();
    assert!(sentence.contains("the checksum of all data before it should be"), "{sentence}");
}

#[test]
fn a_compression_that_is_not_known_is_named() {
    let folder = Folder::new();
    let path = folder.join("trip.mcap");
    write_small(&path, Compression::Zstd, Some(300), true);
    let mut bytes = std::fs::read(&path).unwrap();
    let first = 8 + first_record_bytes(&bytes);
    let name = first + 9 + 8 + 8 + 8 + 4 + 4;
    assert_eq!(&bytes[name..name + 4], b"zstd");
    bytes[name..name + 4].copy_from_slice(b"lzma");
    std::fs::write(&path, &bytes).unwrap();
    assert_eq!(
        refusal(&path, &Selection::default()),
        format!(
            "{} has a chunk compressed with 'lzma' at byte {first}; zstd, lz4 and none are read",
            path.display()
        )
    );
}

#[test]
fn a_chunk_that_cannot_be_decompressed_is_told() {
    let folder = Folder::new();
    let path = folder.join("trip.mcap");
    for (compression, name) in [(Compression::Zstd, "zstd"), (Compression::Lz4, "lz4")] {
        write_small(&path, compression, Some(300), true);
        let mut bytes = std::fs::read(&path).unwrap();
        let first = 8 + first_record_bytes(&bytes);
        // The signature with which either compression begins.
        let signature = first + 9 + 8 + 8 + 8 + 4 + 4 + name.len() + 8;
        bytes[signature] ^= 0xff;
        std::fs::write(&path, &bytes).unwrap();
        let sentence = refusal(&path, &Selection::default());
        let expected = format!(
            "{} is damaged at byte {first}: a chunk could not be decompressed ({name}: ",
            path.display()
        );
        assert!(sentence.starts_with(&expected), "{sentence}");
    }
}

#[test]
fn a_record_in_a_chunk_that_overruns_it_is_damage_even_without_a_checksum() {
    let folder = Folder::new();
    let path = folder.join("trip.mcap");
    write_unchecked(&path, true);
    let mut bytes = std::fs::read(&path).unwrap();
    let message = scan((1000, 3), &[1.0, 2.0]);
    let data = bytes.windows(message.len()).position(|window| window == message).unwrap();
    // The length of the message's record stands before its 22 bytes of header.
    bytes[data - 22 - 8 + 3] = 1;
    std::fs::write(&path, &bytes).unwrap();
    let sentence = read(&path).unwrap().failure.unwrap().to_string();
    assert!(sentence.ends_with(": a record there is shorter than what it says it holds"), "{sentence}");
}

#[test]
fn an_attachment_is_stepped_over() {
    let folder = Folder::new();
    let path = folder.join("trip.mcap");
    let mut bag = Bag::create(&path);
    let id = bag.topic("/scan", LASER_SCAN);
    bag.message(id, 1, &scan((1000, 0), &[1.0]));
    bag.attach("map.pgm", &[3; 100_000]);
    bag.message(id, 2, &scan((1000, 1), &[2.0]));
    bag.finish();
    assert_eq!(read_whole(&path).counts(), [[1000], [2000]]);
}

pub(crate) fn flips(bytes: &[u8]) -> impl Iterator<Item = (usize, u8)> {
    (0..bytes.len()).flat_map(|index| [0x01, 0x80].map(|flip| (index, flip)))
}

fn read_flipped(folder: &Folder, whole: &[u8], index: usize, flip: u8) -> Result<Read, TripError> {
    let mut bytes = whole.to_vec();
    bytes[index] ^= flip;
    read(&folder.write("flipped.mcap", &bytes))
}

/// Bytes of the first record (the header) with its head.
fn first_record_bytes(bytes: &[u8]) -> usize {
    9 + u64::from_le_bytes(bytes[9..17].try_into().unwrap()) as usize
}

/// Where each chunk of a whole file ends.
pub(crate) fn chunk_ends(bytes: &[u8]) -> Vec<usize> {
    let mut ends = Vec::new();
    let mut at_byte = 8;
    while at_byte + 9 < bytes.len() {
        let opcode = bytes[at_byte];
        let n_bytes = u64::from_le_bytes(bytes[at_byte + 1..at_byte + 9].try_into().unwrap());
        let Some(end) = at_byte.checked_add(9).and_then(|body| body.checked_add(n_bytes as usize)) else {
            break;
        };
        if opcode == mcap::records::op::CHUNK {
            ends.push(end);
        }
        at_byte = end;
    }
    ends
}

/// A sentence without the checksums and sizes in it, which depend on how the writer lays out its bytes.
fn without_numbers(sentence: &str) -> String {
    let mut masked = Vec::new();
    let words: Vec<&str> = sentence.split(' ').collect();
    for (index, word) in words.iter().enumerate() {
        let previous = if index > 0 { words[index - 1] } else { "" };
        let is_number =
            matches!(previous, "be" | "is" | "hold" | "holds" | "of") && !word.starts_with("damaged");
        masked.push(if is_number { "#" } else { word });
    }
    masked.join(" ")
}
