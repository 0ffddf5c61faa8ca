//! What is saved of damaged ROS 1 bags. The bags are those of the fuzz corpus, which rosbags wrote.

use std::path::Path;
use std::process::Command;

use kinds_trips::{Salvage, SalvageError, Selection, TripInfo};

use crate::bag::{Folder, read_with};
use crate::read_elsewhere::rosbags_is_here;
use crate::salvage::{Message, messages, saved};

/// A bag of the corpus: its name, and its bytes.
fn corpus(name: &str) -> Vec<u8> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/corpus/bag").join(name);
    std::fs::read(path).unwrap()
}

const WHOLE: [&str; 4] = ["whole-ros1", "whole-ros1-bz2", "whole-ros1-lz4", "whole-ros1-cloud"];

/// The frames of each topic that has some, in one file.
fn frames(path: &Path) -> Vec<(String, Vec<Vec<u16>>)> {
    let Ok(info) = TripInfo::read(path) else { return Vec::new() };
    let of = |name: String| {
        let selection = Selection { frames_topic: Some(name.clone()), ..Selection::default() };
        (name, read_with(path, &selection).map_or(Vec::new(), |trip| trip.counts()))
    };
    info.frames().into_iter().map(|choice| of(choice.name)).collect()
}

/// How many messages are in both, in this order, one after the other.
fn n_common(found: &[Message], whole: &[Message]) -> usize {
    let mut rest = whole.iter();
    found.iter().filter(|message| rest.any(|other| other == *message)).count()
}

#[test]
fn all_of_a_whole_bag_is_saved_as_it_was_and_nothing_is_lost() {
    let folder = Folder::new();
    for name in WHOLE {
        let bytes = corpus(name);
        let (salvage, found) = saved(&folder, &bytes).unwrap();
        assert!(salvage.was_closed && salvage.losses.is_empty(), "{name}: {salvage:?}");
        assert_eq!(salvage.n_messages_recorded, Some(found.len() as u64), "{name}");
        let (before, after) = (frames(&folder.join("wreck.mcap")), frames(&folder.join("saved.mcap")));
        assert!(!before.is_empty() && before.iter().all(|(_, frames)| !frames.is_empty()), "{name}");
        assert_eq!(before, after, "{name}");
        // As MCAP has messages of ROS 1.
        let bytes = std::fs::read(folder.join("saved.mcap")).unwrap();
        for channel in mcap::Summary::read(&bytes).unwrap().unwrap().channels.values() {
            let schema = channel.schema.as_ref().unwrap();
            assert_eq!((&*channel.message_encoding, &*schema.encoding), ("ros1", "ros1msg"));
            assert!(!schema.data.is_empty() && channel.metadata["md5sum"].len() == 32, "{channel:?}");
        }
    }
}

#[test]
fn of_a_bag_cut_off_anywhere_all_messages_before_are_saved() {
    let folder = Folder::new();
    for name in WHOLE {
        let bytes = corpus(name);
        let whole = saved(&folder, &bytes).unwrap().1;
        let mut n_before = 0;
        for n_bytes in (13..bytes.len()).step_by(53) {
            match saved(&folder, &bytes[..n_bytes]) {
                Ok((salvage, found)) => {
                    assert!(whole.starts_with(&found), "{name} {n_bytes}");
                    assert!(found.len() >= n_before, "{name} {n_bytes}: more bytes give no fewer messages");
                    assert!(!salvage.was_closed, "{name} {n_bytes}");
                    let end = salvage.losses.last().map(|loss| loss.at_byte + loss.n_bytes);
                    assert!(salvage.n_losses <= 1 && end.is_none_or(|end| end == n_bytes as u64));
                    n_before = found.len();
                    let n_read = |file: &str| -> usize {
                        frames(&folder.join(file)).iter().map(|(_, frames)| frames.len()).sum()
                    };
                    assert!(
                        n_read("saved.mcap") >= n_read("wreck.mcap"),
                        "{name} {n_bytes}: no fewer frames"
                    );
                }
                Err(SalvageError::Nothing { .. }) => assert_eq!(n_before, 0, "{name} {n_bytes}"),
                Err(error) => panic!("{name} {n_bytes}: {error}"),
            }
        }
        assert_eq!(n_before, whole.len(), "{name}: the index is not needed");
    }
}

#[test]
fn what_stands_in_the_chunk_of_a_recorder_that_was_killed_is_saved() {
    let folder = Folder::new();
    let (salvage, found) = saved(&folder, &corpus("whole-ros1-until-killed")).unwrap();
    assert!(!salvage.was_closed && !found.is_empty(), "{salvage:?}");
    let whole = saved(&folder, &corpus("whole-ros1")).unwrap().1;
    assert!(whole.starts_with(&found));
    // Of a compressed chunk the same: where it ends, only the file's end says. What of it was written can be decompressed.
    let bytes = corpus("whole-ros1-lz4");
    let (chunk, index) = (13 + 4096, index_at(&bytes));
    let header_bytes = u32::from_le_bytes(bytes[chunk..chunk + 4].try_into().unwrap()) as usize;
    let mut open = bytes[..index].to_vec();
    let size = bytes.windows(5).position(|window| window == b"size=").unwrap() + 5;
    open[size..size + 4].fill(0);
    open[chunk + 4 + header_bytes..chunk + 8 + header_bytes].fill(0);
    let (salvage, found) = saved(&folder, &open).unwrap();
    assert_eq!((found, salvage.was_closed), (saved(&folder, &bytes).unwrap().1, false));
}

/// Where a bag says that its index begins.
fn index_at(bytes: &[u8]) -> usize {
    let at = bytes.windows(10).position(|window| window == b"index_pos=").unwrap() + 10;
    u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize
}

#[test]
fn a_wrong_byte_costs_the_message_that_it_is_in_and_at_most_its_neighbour() {
    let folder = Folder::new();
    let bytes = corpus("whole-ros1");
    let whole = saved(&folder, &bytes).unwrap().1;
    let connections: Vec<usize> =
        (0..bytes.len() - 6).filter(|&at| bytes[at..].starts_with(b"topic=")).collect();
    for (index, flip) in (13..bytes.len()).step_by(23).zip([0x01, 0x81, 0x20, 0xff].into_iter().cycle()) {
        let mut flipped = bytes.clone();
        flipped[index] ^= flip;
        let (salvage, found) = saved(&folder, &flipped).unwrap();
        // What a connection says of its topic and type is that of all its messages, and has no checksum either.
        let is_near_connection = connections.iter().any(|&at| at.abs_diff(index) < 3000);
        let n_wrong = whole.len() - n_common(&found, &whole);
        assert!(n_wrong <= 2 || is_near_connection, "byte {index} ^ {flip:#x}: {n_wrong} of {salvage:?}");
    }
}

#[test]
fn damage_costs_what_it_hits_and_is_told() {
    let folder = Folder::new();
    let bytes = corpus("whole-ros1");
    let whole = saved(&folder, &bytes).unwrap().1;
    // The header of the chunk, which is not compressed, is not needed.
    let mut chunk = bytes.clone();
    chunk[13 + 4096..13 + 4096 + 30].fill(0xff);
    let (salvage, found) = saved(&folder, &chunk).unwrap();
    assert_eq!((found, salvage.n_losses), (whole.clone(), 1));
    let first = salvage.losses[0].to_string();
    assert!(first.starts_with("bytes 13 to 4158: a record there does not end where it says"), "{first}");
    // Some bytes in the middle are gone.
    let (middle, end) = ((13 + 4096 + index_at(&bytes)) / 2, index_at(&bytes));
    let without = [&bytes[..middle], &bytes[middle + 700..]].concat();
    let (salvage, found) = saved(&folder, &without).unwrap();
    assert!(!found.is_empty() && n_common(&found, &whole) >= found.len() - 1, "{salvage:?}");
    assert!(salvage.n_losses >= 1 && !salvage.was_closed);
    // The index is nought: nothing of the data is.
    let mut blank = bytes.clone();
    blank[end..].fill(0);
    let (salvage, found) = saved(&folder, &blank).unwrap();
    assert_eq!((found, salvage.n_losses, salvage.was_closed), (whole, 1, false));
    // A chunk of a compression that nobody knows, and one whose bytes are others.
    let sentence = |bytes: &[u8]| saved(&folder, bytes).map(|_| ()).unwrap_err().to_string();
    let nothing = |n_bytes: usize| {
        let path = folder.join("wreck.mcap");
        format!("{} has no whole message to save in its {n_bytes} bytes", path.display())
    };
    let other = corpus("ros1-other-compression");
    let outcome: Result<(Salvage, Vec<Message>), SalvageError> = saved(&folder, &other);
    let (salvage, found) = outcome.unwrap();
    assert!(
        salvage.losses[0].what.contains("is compressed with 'lzma'; bz2, lz4 and none are read"),
        "{salvage:?}"
    );
    assert!(!found.is_empty(), "what stands in it is not compressed after all");
    let mut garbled = corpus("whole-ros1-bz2");
    garbled[13 + 4096 + 300] ^= 0xff;
    assert_eq!(sentence(&garbled), nothing(garbled.len()));
    assert_eq!(sentence(b"#ROSBAG V2.0\n"), nothing(13));
}

/// Prints every message of a bag: topic, type, time, and its bytes.
const PRINT_BAG: &str = r#"
import sys
from rosbags.rosbag1 import Reader

with Reader(sys.argv[1]) as reader:
    for connection, logged, raw in reader.messages():
        print(connection.topic, connection.msgtype, logged, bytes(raw).hex())
"#;

#[test]
fn what_is_saved_is_what_rosbags_reads() {
    if !rosbags_is_here() {
        return;
    }
    let folder = Folder::new();
    for name in WHOLE {
        let bag = folder.write("whole.bag", &corpus(name));
        let output = Command::new("python3").arg("-c").arg(PRINT_BAG).arg(&bag).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        kinds_trips::salvage(&bag, &folder.join("whole.mcap")).unwrap();
        let hex = |bytes: &[u8]| bytes.iter().map(|byte| format!("{byte:02x}")).collect::<String>();
        let line = |(topic, type_name, log_time, _, data): &Message| {
            format!("{topic} {} {log_time} {}", type_name.replace('/', "/msg/"), hex(data))
        };
        let mut lines: Vec<String> = messages(&folder.join("whole.mcap")).iter().map(line).collect();
        let printed = String::from_utf8(output.stdout).unwrap();
        let mut expected: Vec<&str> = printed.lines().collect();
        // It orders messages by their times.
        lines.sort();
        expected.sort_unstable();
        assert_eq!(lines, expected, "{name}");
    }
}
