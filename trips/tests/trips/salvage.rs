//! What is saved of damaged recordings: all that is whole, and nothing else.

use std::collections::BTreeSet;
use std::path::Path;

use kinds_trips::{Salvage, SalvageError, salvage};

use crate::bag::{Bag, Folder, LASER_SCAN, ODOMETRY, odometry, read, read_whole, scan};
use crate::damage::{N_FRAMES, chunk_ends, flips, layouts, write_unchecked};

/// A message of a recording: topic, type, time, number, and its bytes.
pub(crate) type Message = (String, String, u64, u32, Vec<u8>);

/// All messages of a whole recording, in the order of the file.
pub(crate) fn messages(path: &Path) -> Vec<Message> {
    let bytes = std::fs::read(path).unwrap();
    let stream = mcap::MessageStream::new(&bytes).unwrap();
    let message = |message: mcap::Message<'_>| {
        let channel = message.channel;
        let type_name = channel.schema.as_ref().unwrap().name.clone();
        (channel.topic.clone(), type_name, message.log_time, message.sequence, message.data.into_owned())
    };
    stream.map(|found| message(found.unwrap())).collect()
}

/// Saves from these bytes; what came of it, and the messages that were saved. Afterwards the wreck is as it was, and there is
/// no other file than it and what was saved.
pub(crate) fn saved(folder: &Folder, bytes: &[u8]) -> Result<(Salvage, Vec<Message>), SalvageError> {
    let (from, to) = (folder.write("wreck.mcap", bytes), folder.join("saved.mcap"));
    let _ = std::fs::remove_file(&to);
    let before = folder.names();
    let outcome = salvage(&from, &to);
    assert_eq!(std::fs::read(&from).unwrap(), bytes, "what is saved from is only read");
    let mut expected = before;
    if outcome.is_ok() {
        expected.push("saved.mcap".to_owned());
        expected.sort();
    }
    assert_eq!(folder.names(), expected);
    let salvage = outcome?;
    let found = messages(&to);
    assert_eq!(salvage.n_messages, found.len() as u64);
    Ok((salvage, found))
}

#[test]
fn all_of_a_whole_recording_is_saved_and_nothing_is_lost() {
    let folder = Folder::new();
    for bytes in layouts(&folder) {
        let whole = messages(&folder.write("whole.mcap", &bytes));
        let (salvage, found) = saved(&folder, &bytes).unwrap();
        assert_eq!(found, whole);
        assert_eq!((salvage.n_losses, salvage.n_messages_unknown, salvage.n_topics), (0, 0, 3));
        assert!(salvage.was_closed && !salvage.may_be_wrong);
        let frames = read_whole(&folder.join("saved.mcap")).frames;
        assert_eq!(frames, read_whole(&folder.join("whole.mcap")).frames);
    }
}

#[test]
fn of_a_recording_cut_off_anywhere_all_messages_before_are_saved() {
    let folder = Folder::new();
    for bytes in layouts(&folder) {
        let whole = messages(&folder.write("whole.mcap", &bytes));
        let mut n_before = 0;
        // Not all: each one waits for the disk.
        for n_bytes in (0..bytes.len()).rev().step_by(13).collect::<Vec<_>>().into_iter().rev() {
            match saved(&folder, &bytes[..n_bytes]) {
                Ok((salvage, found)) => {
                    assert!(whole.starts_with(&found), "{n_bytes}");
                    assert!(found.len() >= n_before, "{n_bytes}: more bytes give no fewer messages");
                    assert!(!salvage.was_closed || found.len() == whole.len());
                    n_before = found.len();
                    let frames = read(&folder.join("wreck.mcap")).map_or(0, |trip| trip.frames.len());
                    assert!(
                        read_whole_or_none(&folder) >= frames,
                        "{n_bytes}: no fewer than are read without"
                    );
                }
                Err(SalvageError::Nothing { n_bytes: told, .. }) => {
                    assert_eq!((n_before, told), (0, n_bytes as u64));
                }
                Err(SalvageError::Read(_)) => assert_eq!(n_bytes, 0),
                Err(error) => panic!("{n_bytes}: {error}"),
            }
        }
        assert_eq!(n_before, whole.len());
    }
}

/// Frames in what was saved.
fn read_whole_or_none(folder: &Folder) -> usize {
    read(&folder.join("saved.mcap")).map_or(0, |trip| trip.frames.len())
}

#[test]
fn of_a_recording_with_a_wrong_byte_anywhere_what_is_saved_is_as_it_was_recorded() {
    let folder = Folder::new();
    for bytes in layouts(&folder) {
        let whole = messages(&folder.write("whole.mcap", &bytes));
        let is_chunked = !chunk_ends(&bytes).is_empty();
        let (mut n_flips, mut n_saved) = (0, 0);
        for (index, flip) in flips(&bytes).step_by(19) {
            let mut flipped = bytes.clone();
            flipped[index] ^= flip;
            n_flips += 1;
            let Ok((salvage, found)) = saved(&folder, &flipped) else { continue };
            n_saved += found.len();
            let is_as_recorded = is_part_of(&found, &whole);
            // Without chunks there is one checksum, of all data: it tells that something is wrong, and not what.
            let is_told = !is_chunked && (salvage.may_be_wrong || salvage.n_losses > 0);
            let has_no_checksum = salvage.n_messages_unknown > 0;
            assert!(is_as_recorded || is_told || has_no_checksum, "byte {index} ^ {flip:#x}: {salvage:?}");
        }
        // A wrong byte costs a chunk, of which there are three; where nothing repeats what topics there are, the first of them
        // may cost all.
        assert!(2 * n_saved > n_flips * whole.len(), "{n_saved} of {n_flips} times {}", whole.len());
    }
}

/// Whether messages are some of others, in their order.
fn is_part_of(some: &[Message], all: &[Message]) -> bool {
    let mut all = all.iter();
    some.iter().all(|message| all.any(|other| other == message))
}

#[test]
fn what_was_lost_is_told_in_words_and_everything_around_it_is_saved() {
    let folder = Folder::new();
    let path = folder.join("trip.mcap");
    write_unchecked(&path, true);
    // A chunk with what the topic is, and one with each message.
    let mut bag = Bag::with_options(&path, mcap::WriteOptions::new().compression(None).chunk_size(Some(1)));
    let id = bag.topic("/scan", LASER_SCAN);
    for index in 0..u32::from(N_FRAMES) {
        bag.message(id, u64::from(index), &scan((1000, index), &[1.0, 2.0]));
    }
    bag.attach("map.pgm", &[3; 100]);
    bag.finish();
    let bytes = std::fs::read(&path).unwrap();
    let whole = messages(&path);
    let ends = chunk_ends(&bytes);
    let others = |lost: usize| [&whole[..lost], &whole[lost + 1..]].concat();

    // The last byte of the second message.
    let mut flipped = bytes.clone();
    flipped[ends[2] - 1] ^= 1;
    let (salvage, found) = saved(&folder, &flipped).unwrap();
    assert_eq!((found, salvage.n_losses, salvage.n_messages_recorded), (others(1), 1, Some(5)));
    let told = salvage.losses[0].to_string();
    assert!(told.contains(": a chunk's checksum should be "), "{told}");
    assert_eq!(salvage.losses[0].at_byte + salvage.losses[0].n_bytes, ends[2] as u64);
    let attached = std::fs::read(folder.join("saved.mcap")).unwrap();
    assert!(attached.windows(100).any(|window| window == [3; 100]), "attachments are saved too");

    // The length of the second message's chunk lies; what is in it agrees with its checksum all the same.
    let length = ends[1] + message_index_bytes(&bytes, ends[1]) + 1;
    for (byte, flip, n_saved_of_loss) in [(0, 4, 0), (3, 1, 1), (7, 0x80, 1)] {
        let mut lying = bytes.clone();
        lying[length + byte] ^= flip;
        let (salvage, found) = saved(&folder, &lying).unwrap();
        assert_eq!((&found, salvage.losses[0].n_messages_saved), (&whole, n_saved_of_loss), "{byte}");
    }

    // Some bytes in the middle are gone.
    let without = [&bytes[..ends[2] - 20], &bytes[ends[2]..]].concat();
    let (salvage, found) = saved(&folder, &without).unwrap();
    assert_eq!((found, salvage.n_losses), (others(1), 1));

    // Some bytes in the middle are nought, more than a record.
    let mut blank = bytes.clone();
    blank[ends[1]..ends[3]].fill(0);
    let (salvage, found) = saved(&folder, &blank).unwrap();
    assert_eq!((found, salvage.n_losses), ([&whole[..1], &whole[3..]].concat(), 1));
    assert!(salvage.losses[0].to_string().ends_with(": what stands there is no record"), "{salvage:?}");

    // The index at the end is nought, all but the footer.
    let mut blank = bytes.clone();
    let footer = bytes.len() - mcap::MAGIC.len() - 9 - 20;
    blank[ends[5]..footer].fill(0);
    let (salvage, found) = saved(&folder, &blank).unwrap();
    assert_eq!((found, salvage.n_losses, salvage.was_closed), (whole.clone(), 1, true));

    // The first byte of all.
    let mut magic = bytes.clone();
    magic[0] ^= 1;
    assert_eq!(saved(&folder, &magic).unwrap().1, whole);
}

/// Bytes of the records with which a chunk's index begins at a byte.
fn message_index_bytes(bytes: &[u8], mut at_byte: usize) -> usize {
    let begin = at_byte;
    while bytes[at_byte] == mcap::records::op::MESSAGE_INDEX {
        at_byte += 9 + u64::from_le_bytes(bytes[at_byte + 1..at_byte + 9].try_into().unwrap()) as usize;
    }
    at_byte - begin
}

#[test]
fn messages_whose_topic_is_lost_are_counted_and_not_saved() {
    let folder = Folder::new();
    let path = folder.join("trip.mcap");
    // No summary repeats what the first chunk says of the topics.
    let options = mcap::WriteOptions::new().chunk_size(Some(1)).repeat_channels(false).repeat_schemas(false);
    let mut bag = Bag::with_options(&path, options);
    let id = bag.topic("/scan", LASER_SCAN);
    for index in 0..3 {
        bag.message(id, u64::from(index), &scan((1000, index), &[1.0]));
        if index == 0 {
            let other = bag.topic("/other", ODOMETRY);
            bag.message(other, 0, &odometry((1000, 0), 2.0));
        }
    }
    bag.finish();
    let mut bytes = std::fs::read(&path).unwrap();
    let first = chunk_ends(&bytes)[0];
    bytes[first - 1] ^= 1;
    let outcome = saved(&folder, &bytes).map(|(salvage, found)| (salvage.n_messages_unknown, found.len()));
    assert_eq!(outcome.ok(), Some((3, 1)), "only the second topic was named after the first chunk");
}

#[test]
fn what_has_nothing_whole_is_refused_and_leaves_nothing() {
    let folder = Folder::new();
    let check = |bytes: &[u8], expected: &str| {
        let sentence = saved(&folder, bytes).map(drop).unwrap_err().to_string();
        let path = folder.join("wreck.mcap");
        assert_eq!(sentence, expected.replace("WRECK", &path.display().to_string()));
    };
    check(b"hello, this is no recording at all", "WRECK has no whole message to save in its 34 bytes");
    check(mcap::MAGIC, "WRECK has no whole message to save in its 8 bytes");
    check(b"", "WRECK is empty (0 bytes): nothing was recorded");
    let missing = folder.join("missing.mcap");
    let sentence = salvage(&missing, &folder.join("saved.mcap")).unwrap_err().to_string();
    assert_eq!(sentence, format!("no trip at {}: there is no such file", missing.display()));
    let taken = folder.join("taken");
    std::fs::create_dir(&taken).unwrap();
    let whole = folder.join("whole.mcap");
    write_unchecked(&whole, true);
    let sentence = salvage(&whole, &taken).unwrap_err().to_string();
    assert_eq!(
        sentence,
        format!("could not write {}: it is a directory; name a file in it", taken.display())
    );
}

#[test]
fn a_wrong_byte_in_a_recording_without_checksums_never_saves_a_message_twice() {
    let folder = Folder::new();
    let path = folder.join("trip.mcap");
    for is_chunked in [true, false] {
        write_unchecked(&path, is_chunked);
        let bytes = std::fs::read(&path).unwrap();
        for (index, flip) in flips(&bytes).step_by(5) {
            let mut flipped = bytes.clone();
            flipped[index] ^= flip;
            if let Ok((salvage, found)) = saved(&folder, &flipped) {
                let different: BTreeSet<&Message> = found.iter().collect();
                assert_eq!(different.len(), found.len(), "byte {index} ^ {flip:#x}: {salvage:?}");
            }
        }
    }
}
