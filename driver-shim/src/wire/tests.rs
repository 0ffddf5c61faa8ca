//! What must hold of frames that come as bytes: by the table in the documents, by chance, and from devices that misbehave.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, Write};
use std::net::UdpSocket;
use std::os::fd::OwnedFd;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::time::{Duration, Instant};

use kinds_trips::{FrameLayout, Stamp};
use proptest::prelude::*;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

use super::link::{Link, Pipe, Received};
use super::part::{MAGIC, VERSION};
use super::{Address, LeftOut, Part, READINGS_MAX, WireError, Wired};
use crate::{Capture, LayoutError, NumberedFrame, Reading, Sensor};

const RING: FrameLayout = FrameLayout { rows: 1, columns: 16, metres_per_count: 0.001 };
const CAMERA: FrameLayout = FrameLayout { rows: 3, columns: 5, metres_per_count: 0.0005 };
const TICK: Duration = Duration::from_millis(20);
const DEADLINE: Duration = Duration::from_secs(20);

/// Gives what it has, a receipt at a time, and ends.
struct Script {
    receipts: VecDeque<Vec<u8>>,
    is_of_messages: bool,
}

impl Link for Script {
    fn is_of_messages(&self) -> bool {
        self.is_of_messages
    }

    fn receive(&mut self, room: &mut [u8], _timeout: Duration) -> Result<Received, io::Error> {
        let Some(mut bytes) = self.receipts.pop_front() else { return Ok(Received::End) };
        let n_bytes = bytes.len().min(room.len());
        assert!(n_bytes > 0, "there is always room");
        room[..n_bytes].copy_from_slice(&bytes[..n_bytes]);
        if n_bytes < bytes.len() && !self.is_of_messages {
            self.receipts.push_front(bytes.split_off(n_bytes));
        }
        Ok(Received::Bytes(n_bytes))
    }
}

fn scripted(layout: FrameLayout, receipts: impl Into<VecDeque<Vec<u8>>>, is_of_messages: bool) -> Wired {
    let script = Script { receipts: receipts.into(), is_of_messages };
    Wired::over(Box::new(script), Address::Stdin, layout)
}

type Frame = (NumberedFrame, Vec<u16>);

/// Reads until the device ends or so many frames have come: these, and what was told.
fn read(device: &mut Wired, n_frames: usize) -> (Vec<Frame>, Vec<String>) {
    let until = Instant::now() + DEADLINE;
    let (mut frames, mut news) = (Vec::new(), Vec::new());
    let mut counts = vec![0; device.layout().n_readings()];
    while frames.len() < n_frames {
        let reading = device.read(&mut counts, TICK).unwrap();
        news.extend(std::iter::from_fn(|| device.news()));
        match reading {
            // As the shim does: the next frame has another slice.
            Reading::Numbered(frame) => {
                frames.push((frame, std::mem::replace(&mut counts, vec![0; frame.n_readings])));
            }
            Reading::End => break,
            _ => assert!(Instant::now() < until, "{} frames came; told {news:?}", frames.len()),
        }
    }
    (frames, news)
}

/// Counts of a frame that no other frame has.
fn counts_of(layout: FrameLayout, sequence: u32) -> Vec<u16> {
    (0..layout.n_readings() as u32).map(|index| (sequence * 1009 + index * 31) as u16).collect()
}

fn parts_of(layout: FrameLayout, sequence: u32, n_readings_most: usize) -> Vec<Vec<u8>> {
    let mut parts = Vec::new();
    let counts = counts_of(layout, sequence);
    Part::each_of_frame(layout, sequence, 5000 + i64::from(sequence), &counts, n_readings_most, |part| {
        parts.push(part.to_vec());
    });
    parts
}

fn whole(layout: FrameLayout, sequence: u32) -> Vec<u8> {
    parts_of(layout, sequence, READINGS_MAX).concat()
}

/// What must come of a frame of [`parts_of`].
fn frame_of(layout: FrameLayout, device: u32, sequence: u64) -> Frame {
    let captured = Stamp(5000 + i64::from(device));
    let capture = Capture::at(captured);
    let counts = counts_of(layout, device);
    (NumberedFrame { capture, sequence, n_readings: counts.len() }, counts)
}

#[test]
fn the_table_in_the_documents_is_what_is_sent() {
    let part = Part {
        n_readings: 3,
        rows: 2,
        columns: 0x0102_0304,
        nanometres_per_count: 1_000_000,
        sequence: 0xfedc_ba98,
        captured_ns: -123_456_789_012,
        first_reading: 77,
    };
    let mut bytes = Vec::new();
    part.encode(&[1, 500, 65_535], &mut bytes);
    let mut at = 0;
    let mut n_rows = 0;
    for row in include_str!("../../../docs/wire.md").lines().filter(|line| line.contains(" | `")) {
        let cells: Vec<&str> = row.trim_matches('|').split('|').map(str::trim).collect();
        // What depends on the number of readings, for three.
        let number = |cell: &str| match cell {
            "40 + 2 × `n_readings`" => 46,
            "2 × `n_readings`" => 6,
            number => number.parse::<usize>().unwrap(),
        };
        assert_eq!(number(cells[0]), at, "{row}");
        let field = &bytes[at..at + number(cells[1])];
        let expected = match cells[2].trim_matches('`') {
            "magic" => MAGIC.to_vec(),
            "version" => VERSION.to_le_bytes().to_vec(),
            "n_readings" => 3_u16.to_le_bytes().to_vec(),
            "rows" => 2_u32.to_le_bytes().to_vec(),
            "columns" => 0x0102_0304_u32.to_le_bytes().to_vec(),
            "nanometres_per_count" => 1_000_000_u32.to_le_bytes().to_vec(),
            "sequence" => 0xfedc_ba98_u32.to_le_bytes().to_vec(),
            "captured_ns" => (-123_456_789_012_i64).to_le_bytes().to_vec(),
            "first_reading" => 77_u32.to_le_bytes().to_vec(),
            "header_crc" => plain_crc32(&bytes[..36]).to_le_bytes().to_vec(),
            "counts" => vec![1, 0, 0xf4, 1, 0xff, 0xff],
            "counts_crc" => plain_crc32(&bytes[40..46]).to_le_bytes().to_vec(),
            other => panic!("{other} is not sent"),
        };
        assert_eq!(field, expected, "{row}");
        at += field.len();
        n_rows += 1;
    }
    assert_eq!((at, n_rows), (bytes.len(), 12));
    assert!(include_str!("../../../docs/wire.md").contains(&format!("1 to {READINGS_MAX}")));
}

/// CRC-32 bit by bit, as the boards that send it may have it.
fn plain_crc32(bytes: &[u8]) -> u32 {
    let step = |crc: u32| if crc & 1 == 1 { crc >> 1 ^ 0xedb8_8320 } else { crc >> 1 };
    !bytes.iter().fold(!0_u32, |crc, byte| (0..8).fold(crc ^ u32::from(*byte), |crc, _| step(crc)))
}

proptest! {
    #[test]
    fn every_frame_comes_out_of_a_stream_whatever_is_between_and_however_it_is_cut(
        n_readings_most in 1_usize..20,
        noise in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..60), 6),
        receipt in 1_usize..100,
    ) {
        let mut bytes = Vec::new();
        for (sequence, noise) in noise.iter().enumerate() {
            // Noise that ends as a part begins would be one with it, rightly.
            bytes.extend(noise.iter().map(|byte| if *byte == MAGIC[0] { 0 } else { *byte }));
            bytes.extend(parts_of(CAMERA, sequence as u32, n_readings_most).concat());
        }
        let receipts: VecDeque<_> = bytes.chunks(receipt).map(<[u8]>::to_vec).collect();
        let mut device = scripted(CAMERA, receipts, false);
        let (frames, _) = read(&mut device, usize::MAX);
        let expected: Vec<Frame> = (0..6).map(|sequence| frame_of(CAMERA, sequence, sequence.into())).collect();
        prop_assert_eq!(frames, expected);
        let n_noise_bytes = noise.iter().map(Vec::len).sum::<usize>() as u64;
        prop_assert_eq!(device.left_out(), LeftOut { n_noise_bytes, ..LeftOut::default() });
    }

    #[test]
    fn parts_of_a_frame_may_come_in_any_order(order in Just((0..5).collect::<Vec<usize>>()).prop_shuffle()) {
        let parts = parts_of(CAMERA, 0, 3);
        let receipts: VecDeque<_> = order.iter().map(|index| parts[*index].clone()).collect();
        let (frames, news) = read(&mut scripted(CAMERA, receipts, true), usize::MAX);
        prop_assert_eq!(frames, [frame_of(CAMERA, 0, 0)]);
        prop_assert_eq!(news, [""; 0]);
    }

    #[test]
    fn frames_that_are_flipped_cut_or_lost_are_left_out_and_no_others(
        damage in prop::collection::vec((0_u8..5, any::<prop::sample::Index>()), 30),
    ) {
        let (mut bytes, mut expected) = (Vec::new(), Vec::new());
        for (sequence, (damage, place)) in damage.iter().enumerate() {
            let sequence = sequence as u32;
            let mut sent = whole(RING, sequence);
            match damage {
                0 => {
                    let bit = place.index(sent.len() * 8);
                    sent[bit / 8] ^= 1 << (bit % 8);
                }
                1 => sent.truncate(place.index(sent.len())),
                2 => sent.clear(),
                _ => expected.push((sequence, counts_of(RING, sequence))),
            }
            bytes.extend(sent);
        }
        let (frames, _) = read(&mut scripted(RING, [bytes], false), usize::MAX);
        let first = expected.first().map_or(0, |(sequence, _)| *sequence);
        let came: Vec<_> = frames.into_iter().map(|(frame, counts)| (frame.sequence as u32 + first, counts)).collect();
        prop_assert_eq!(came, expected);
    }

    #[test]
    fn whatever_comes_is_no_panic_and_never_a_frame_that_was_not_sent(
        receipts in prop::collection::vec(
            prop_oneof![
                prop::collection::vec(any::<u8>(), 1..300),
                // Sound headers with any numbers in them.
                (any::<[u32; 5]>(), any::<u16>(), any::<bool>()).prop_map(|(numbers, n_readings, is_ours)| {
                    let [rows, columns, nanometres_per_count, sequence, first_reading] = numbers;
                    let ours = if is_ours { (1, 16, 1_000_000) } else { (rows, columns, nanometres_per_count) };
                    let (rows, columns, nanometres_per_count) = ours;
                    let part = Part {
                        n_readings, rows, columns, nanometres_per_count, sequence, captured_ns: 1, first_reading,
                    };
                    let mut bytes = Vec::new();
                    part.encode(&[], &mut bytes);
                    bytes
                }),
            ],
            0..20,
        ),
        is_of_messages: bool,
    ) {
        let n_bytes = receipts.iter().map(Vec::len).sum::<usize>() as u64;
        let mut device = scripted(RING, receipts, is_of_messages);
        let (frames, news) = read(&mut device, usize::MAX);
        prop_assert_eq!(frames, []);
        prop_assert!(device.left_out().n_noise_bytes <= n_bytes);
        prop_assert!(news.len() <= 2, "said once each: {:?}", news);
    }
}

#[test]
fn a_trouble_is_said_once_when_it_begins_and_once_when_it_ends() {
    let mut bytes = b"garbage".to_vec();
    for sequence in 0..250 {
        bytes.extend(whole(RING, sequence));
        if sequence < 5 {
            bytes.extend(b"more");
        }
    }
    bytes.extend(b"again");
    let (frames, news) = read(&mut scripted(RING, [bytes], false), usize::MAX);
    assert_eq!(frames.len(), 250);
    let begins = "bytes come that are no whole frame; they are left out";
    assert_eq!(news, [begins, "frames come as they should again; 27 bytes were left out", begins]);
}

#[test]
fn frames_of_another_layout_are_said_to_be_so_and_frames_after_them_come() {
    let bytes = [whole(CAMERA, 0), whole(CAMERA, 1), whole(RING, 0)].concat();
    let mut device = scripted(RING, [bytes], false);
    let (frames, news) = read(&mut device, usize::MAX);
    assert_eq!(frames, [frame_of(RING, 0, 0)]);
    assert_eq!(
        news,
        ["frames of 3 × 5 readings at 0.0005 m a count come, not of 1 × 16 at 0.001 m; they are left out"]
    );
    assert_eq!(device.left_out(), LeftOut { n_foreign_parts: 2, ..LeftOut::default() });
}

#[test]
fn a_frame_that_lacks_a_part_is_left_out_and_what_comes_late_too() {
    let [first, second] = [0, 1].map(|sequence| parts_of(CAMERA, sequence, 8));
    let receipts = [&first[0], &second[0], &first[1], &second[1], &second[1]].map(Vec::clone);
    let mut device = scripted(CAMERA, receipts, true);
    let (frames, news) = read(&mut device, usize::MAX);
    assert_eq!(frames, [frame_of(CAMERA, 1, 1)]);
    assert_eq!(
        news,
        ["frames come that lack a part; they are left out", "frames come late or again; they are left out"]
    );
    assert_eq!(device.left_out(), LeftOut { n_incomplete: 1, n_late_parts: 2, ..LeftOut::default() });
}

#[test]
fn numbers_go_on_over_their_end_over_losses_and_over_a_device_that_starts_anew() {
    let sent = [u32::MAX - 1, u32::MAX, 0, 3, 500, 40, 41, 40, 42, 3_000_000];
    let expected = [0, 1, 2, 5, 502, 503, 504, 505, 506];
    let receipts: Vec<Vec<u8>> = sent
        .iter()
        .map(|&sequence| {
            let mut bytes = Vec::new();
            Part::each_of_frame(RING, sequence, 1, &[7; 16], READINGS_MAX, |part| bytes.extend(part));
            bytes
        })
        .collect();
    let mut device = scripted(RING, receipts, false);
    let (frames, _) = read(&mut device, usize::MAX);
    let sequences: Vec<u64> = frames.iter().map(|(frame, _)| frame.sequence).collect();
    assert_eq!(sequences, expected);
    assert_eq!(device.left_out().n_late_parts, 1);
}

#[test]
fn a_frame_without_a_time_was_captured_when_it_came() {
    let mut bytes = Vec::new();
    Part::each_of_frame(RING, 0, 0, &[7; 16], READINGS_MAX, |part| bytes.extend(part));
    let before = kinds_messages::ns_since_epoch();
    let (frames, _) = read(&mut scripted(RING, [bytes], false), 1);
    let captured_ns = frames[0].0.capture.captured.0;
    assert!((before..=kinds_messages::ns_since_epoch()).contains(&captured_ns));
}

#[test]
fn datagrams_bring_frames_in_parts_and_one_that_is_cut_spoils_no_other() {
    let listener = UdpSocket::bind("127.0.0.1:0").unwrap();
    let ours = listener.local_addr().unwrap();
    let mut device = Wired::over(Box::new(listener), Address::Udp(ours), CAMERA);
    let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
    let send = |bytes: &[u8]| assert_eq!(sender.send_to(bytes, ours).unwrap(), bytes.len());
    send(&whole(CAMERA, 0)[..50]);
    send(b"");
    parts_of(CAMERA, 1, 4).iter().rev().for_each(|part| send(part));
    send(&whole(CAMERA, 2));
    let (frames, news) = read(&mut device, 2);
    assert_eq!(frames, [frame_of(CAMERA, 1, 0), frame_of(CAMERA, 2, 1)]);
    assert_eq!(news, ["bytes come that are no whole frame; they are left out"]);
    assert_eq!(device.left_out(), LeftOut { n_noise_bytes: 50, ..LeftOut::default() });
}

#[test]
fn a_pipe_ends_the_device_when_it_ends_and_what_had_begun_is_left_out() {
    let (reader, mut writer) = io::pipe().unwrap();
    let mut device = Wired::over(Box::new(Pipe(reader)), Address::Stdin, RING);
    writer.write_all(&[whole(RING, 0), whole(RING, 1)[..20].to_vec()].concat()).unwrap();
    let mut counts = [0; 16];
    assert!(matches!(device.read(&mut counts, TICK), Ok(Reading::Numbered(_))));
    assert!(matches!(device.read(&mut counts, TICK), Ok(Reading::NotYet)));
    drop(writer);
    assert!(matches!(device.read(&mut counts, TICK), Ok(Reading::End)));
    assert_eq!(device.left_out().n_noise_bytes, 20);
}

/// The far end of a serial line whose near end a path leads to.
fn plug_in(path: &Path) -> File {
    let far: OwnedFd = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    grantpt(&far).unwrap();
    unlockpt(&far).unwrap();
    let near = ptsname(&far, Vec::new()).unwrap();
    let _ = std::fs::remove_file(path);
    symlink(near.to_str().unwrap(), path).unwrap();
    far.into()
}

#[test]
fn a_serial_line_outlives_noise_cuts_flips_silence_and_being_unplugged() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ring");
    let address = Address::Serial { path: path.clone(), baud: 115_200 };
    let mut device = Wired::open(address, RING).unwrap();
    let mut counts = [0; 16];
    // Not there yet: said, and not the end.
    assert_eq!(device.read(&mut counts, TICK).unwrap(), Reading::NotYet);
    let gone = device.news().unwrap();
    assert!(gone.starts_with(&format!("{} cannot be read: ", path.display())), "{gone}");
    assert!(gone.ends_with("; waiting until it can"), "{gone}");

    let mut board = plug_in(&path);
    let back = format!("{} can be read", path.display());
    let await_back = |device: &mut Wired| {
        let until = Instant::now() + DEADLINE;
        loop {
            assert_eq!(device.read(&mut [0; 16], TICK).unwrap(), Reading::NotYet);
            match device.news() {
                Some(news) => break assert_eq!(news, back),
                None => assert!(Instant::now() < until),
            }
        }
    };
    await_back(&mut device);
    let mut flipped = whole(RING, 2);
    flipped[50] ^= 4;
    // Bytes that a terminal would translate, echo, or take for signals, among noise, a cut frame and a flipped one.
    board.write_all(b"\r\n\x03\x04\x11\x13\x1a\x7f\xff").unwrap();
    board.write_all(&whole(RING, 1)[..60]).unwrap();
    board.write_all(&flipped).unwrap();
    board.write_all(&whole(RING, 3)).unwrap();
    let (frames, news) = read(&mut device, 1);
    assert_eq!(frames, [frame_of(RING, 3, 0)]);
    assert_eq!(news, ["bytes come that are no whole frame; they are left out"]);
    assert_eq!(device.left_out().n_noise_bytes, 9 + 60 + flipped.len() as u64);

    // Silence, in the middle of a frame.
    board.write_all(&whole(RING, 4)[..30]).unwrap();
    assert_eq!(device.read(&mut counts, TICK).unwrap(), Reading::NotYet);
    board.write_all(&whole(RING, 4)[30..]).unwrap();
    assert_eq!(read(&mut device, 1).0, [frame_of(RING, 4, 1)]);

    // Unplugged within a frame, and back with numbers from the start.
    board.write_all(&whole(RING, 5)[..30]).unwrap();
    assert_eq!(device.read(&mut counts, TICK).unwrap(), Reading::NotYet);
    drop(board);
    let until = Instant::now() + DEADLINE;
    let gone = loop {
        assert_eq!(device.read(&mut counts, TICK).unwrap(), Reading::NotYet);
        assert!(Instant::now() < until);
        if let Some(news) = device.news() {
            break news;
        }
    };
    assert!(gone.contains("ring cannot be read: "), "{gone}");
    let mut board = plug_in(&path);
    await_back(&mut device);
    for sequence in 0..2 {
        board.write_all(&whole(RING, sequence)).unwrap();
    }
    assert_eq!(read(&mut device, 2).0, [frame_of(RING, 0, 2), frame_of(RING, 1, 3)]);
}

#[test]
fn addresses_are_read_as_they_are_written_or_refused_in_words() {
    for text in ["udp://127.0.0.1:4000", "udp://[::1]:4000", "stdin", "serial:///dev/ttyUSB0?baud=9600"] {
        assert_eq!(text.parse::<Address>().unwrap().to_string(), text);
    }
    assert_eq!("serial:///dev/a".parse::<Address>().unwrap().to_string(), "serial:///dev/a?baud=115200");
    for text in [
        "",
        "udp://",
        "udp://robot:4000",
        "tcp://127.0.0.1:4000",
        "serial://ttyUSB0",
        "serial:///dev/ttyUSB0?baud=0",
        "serial:///dev/ttyUSB0?parity=even",
        "stdin://",
    ] {
        assert_eq!(
            text.parse::<Address>().unwrap_err().to_string(),
            format!(
                "device \"{text}\" is none of udp://ADDRESS:PORT (such as udp://127.0.0.1:4000), stdin, \
                 serial:///dev/NAME or serial:///dev/NAME?baud=115200, and v4l2:///dev/NAME or \
                 v4l2:///dev/NAME?rate_hz=30"
            )
        );
    }
}

#[test]
fn what_cannot_be_read_is_refused_in_words() {
    let refused = |address: &str, layout| match Wired::open(address.parse().unwrap(), layout) {
        Err(error) => error.to_string(),
        Ok(_) => panic!("{address} is read"),
    };
    for (rows, columns) in [(0, 16), (1, 0), (u32::MAX, u32::MAX), (1 << 12, (1 << 12) + 1)] {
        assert_eq!(
            refused("stdin", FrameLayout { rows, columns, ..RING }),
            format!(
                "frames of {rows} × {columns} readings cannot be read; there must be 1 to 16777216 of them"
            )
        );
    }
    for metres_per_count in [0.0, -0.001, f64::NAN, f64::INFINITY, 5.0] {
        assert_eq!(
            refused("stdin", FrameLayout { metres_per_count, ..RING }),
            format!(
                "one count cannot stand for {metres_per_count} m; it must be between 0.000000001 and 4 m"
            )
        );
    }
    let taken = UdpSocket::bind("127.0.0.1:0").unwrap();
    let address = format!("udp://{}", taken.local_addr().unwrap());
    let said = refused(&address, RING);
    assert!(said.starts_with(&format!("cannot read {address}: ")), "{said}");
    let error = WireError::Layout(LayoutError::Unit { metres_per_count: 9.0 });
    assert!(crate::SensorError::from(error).to_string().starts_with("one count cannot stand for 9 m"));
}
