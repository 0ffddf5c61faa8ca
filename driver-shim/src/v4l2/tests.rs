//! What must hold of depth cameras: against one in memory that holds us to the interface's rules, and against a virtual one of the kernel
//! where it has one.

#![allow(clippy::print_stderr, reason = "a test that is skipped says so")]

use std::cell::RefCell;
use std::rc::Rc;
use std::time::{Duration, Instant};

use kinds_messages::{monotonic_ns, ns_since_epoch};
use kinds_trips::FrameLayout;
use proptest::prelude::*;
use rustix::io::Errno;

use super::abi::{CAN_CAPTURE, CAN_STREAM, DAMAGED};
use super::fake_camera::{Event, Plug, Sent, open};
use super::kernel::KernelDevice;
use super::video_device::VideoDevice;
use super::{CameraAddress, DepthCamera, LeftOut};
use crate::{AddressError, DeviceAddress, LayoutError, NumberedFrame, Reading, Sensor};

const LAYOUT: FrameLayout = FrameLayout { rows: 2, columns: 3, metres_per_count: 0.001 };
const TICK: Duration = Duration::from_millis(20);
const DEADLINE: Duration = Duration::from_secs(20);

type Frame = (NumberedFrame, Vec<u16>);

fn depth_camera() -> Rc<RefCell<Plug>> {
    Plug::new(&[b"Z16 "], &[(3, 2)])
}

fn shim_of(plug: &Rc<RefCell<Plug>>, rate_hz: Option<u32>) -> DepthCamera {
    let plug = plug.clone();
    let address = CameraAddress { path: "/dev/video0".into(), rate_hz };
    DepthCamera::opened_by(Box::new(move |path| open(&plug, path)), address, LAYOUT).unwrap()
}

/// Six counts of a frame that no other frame has.
fn counts_of(number: u32) -> Vec<u16> {
    (0..6).map(|index| (number * 1009 + index * 257) as u16).collect()
}

/// The same as a camera sends them, with a margin behind each row.
fn bytes_of(counts: &[u16], margin_bytes: usize) -> Vec<u8> {
    let rows =
        counts.chunks(3).map(|row| row.iter().flat_map(|count| count.to_le_bytes()).collect::<Vec<u8>>());
    rows.flat_map(|row| [row, vec![0xaa; margin_bytes]].concat()).collect()
}

fn sent(number: u32) -> Sent {
    Sent::new(number, bytes_of(&counts_of(number), 0))
}

fn frame(number: u32) -> Event {
    Event::Frame(sent(number))
}

/// Reads until so many frames have come: these, and what was told.
fn read(camera: &mut DepthCamera, n_frames: usize) -> (Vec<Frame>, Vec<String>) {
    let until = Instant::now() + DEADLINE;
    let (mut frames, mut news) = (Vec::new(), Vec::new());
    let mut counts = vec![0; 6];
    while frames.len() < n_frames {
        let reading = camera.read(&mut counts, TICK).unwrap();
        news.extend(std::iter::from_fn(|| camera.news()));
        match reading {
            Reading::Numbered(frame) => frames.push((frame, std::mem::replace(&mut counts, vec![0; 6]))),
            _ => assert!(Instant::now() < until, "{} frames came; told {news:?}", frames.len()),
        }
    }
    (frames, news)
}

fn refusal(plug: &Rc<RefCell<Plug>>) -> String {
    let error = shim_of(plug, None).read(&mut [0; 6], TICK).unwrap_err();
    assert_eq!(plug.borrow().n_open, 0, "it is closed again");
    error.to_string()
}

#[test]
fn counts_come_as_they_were_sent_with_or_without_margins() {
    for (margin_bytes, says_stride) in [(0, true), (0, false), (2, true), (10, true)] {
        let plug = depth_camera();
        {
            let mut plug = plug.borrow_mut();
            (plug.margin_bytes, plug.says_stride) = (margin_bytes as u32, says_stride);
            // More than there are buffers.
            plug.events.extend(
                (0..20).map(|number| {
                    Event::Frame(Sent::new(number, bytes_of(&counts_of(number), margin_bytes)))
                }),
            );
            // The last row's margin need not be there.
            let mut bytes = bytes_of(&counts_of(20), margin_bytes);
            bytes.truncate(bytes.len() - margin_bytes);
            plug.events.push_back(Event::Frame(Sent::new(20, bytes)));
        }
        let (frames, news) = read(&mut shim_of(&plug, None), 21);
        assert_eq!(news, [""; 0]);
        for (number, (frame, counts)) in frames.iter().enumerate() {
            assert_eq!((frame.sequence, frame.n_readings), (number as u64, 6));
            assert_eq!(*counts, counts_of(number as u32));
        }
        assert_eq!((plug.borrow().n_opened, plug.borrow().n_open), (1, 0));
    }
}

#[test]
fn y16_is_read_where_there_is_no_depth() {
    let plug = Plug::new(&[b"YUYV", b"Y16 "], &[(3, 2)]);
    plug.borrow_mut().events.push_back(frame(0));
    assert_eq!(read(&mut shim_of(&plug, None), 1).0[0].1, counts_of(0));
}

#[test]
fn what_a_camera_has_not_is_refused_with_what_it_has() {
    let colour = Plug::new(&[b"YUYV", b"MJPG"], &[(3, 2)]);
    assert_eq!(
        refusal(&colour),
        "/dev/video0 sends YUYV, MJPG; only Z16 and Y16 can be read (a camera may have another device file for depth)"
    );
    let larger = Plug::new(&[b"Z16 "], &[(640, 480), (424, 240)]);
    assert_eq!(refusal(&larger), "/dev/video0 has no frames of 2 × 3 readings; it has 480 × 640, 240 × 424");
    larger.borrow_mut().lists_sizes = false;
    assert_eq!(refusal(&larger), "/dev/video0 has no frames of 2 × 3 readings; it has 480 × 640");
    larger.borrow_mut().lists_sizes = true;
    larger.borrow_mut().range = Some([16, 640, 8, 12, 480, 4]);
    assert_eq!(
        refusal(&larger),
        "/dev/video0 has no frames of 2 × 3 readings; it has 12 to 480 × 16 to 640, in steps of 4 × 8"
    );
    for capabilities in [0, CAN_CAPTURE, CAN_STREAM] {
        let metadata = depth_camera();
        metadata.borrow_mut().capabilities = capabilities;
        assert_eq!(
            refusal(&metadata),
            "/dev/video0 sends no pictures; name the device file of a camera that does (v4l2-ctl --list-devices shows them)"
        );
    }
    let address = CameraAddress { path: "/dev/video0".into(), rate_hz: None };
    let error = DepthCamera::new(address, FrameLayout { columns: 0, ..LAYOUT }).err();
    assert_eq!(error, Some(LayoutError::Size { rows: 2, columns: 0 }));
}

#[test]
fn damaged_and_short_frames_are_left_out_counted_and_told_once() {
    let plug = depth_camera();
    let damaged = |number| Event::Frame(Sent { flags: sent(number).flags | DAMAGED, ..sent(number) });
    let short = |number| Event::Frame(Sent { bytes: vec![1; 11], ..sent(number) });
    let events = [damaged(0), frame(1), damaged(2), damaged(3), short(4), frame(5), short(6)];
    plug.borrow_mut().events.extend(events.into_iter().chain((7..107).map(frame)));
    let mut camera = shim_of(&plug, None);
    let (frames, news) = read(&mut camera, 102);
    assert_eq!(
        news,
        [
            "frames come damaged, as their driver says; they are left out",
            "frames come short, of 11 bytes instead of 12; they are left out",
            "frames come as they should again; 3 damaged ones were left out",
            "frames come as they should again; 2 short ones were left out",
        ]
    );
    // What was left out is missing among the numbers.
    let sequences: Vec<u64> = frames.iter().map(|(frame, _)| frame.sequence).collect();
    assert_eq!(sequences, [1, 5].into_iter().chain(7..107).collect::<Vec<u64>>());
    assert!(frames.iter().all(|(frame, counts)| *counts == counts_of(frame.sequence as u32)));
    assert_eq!(camera.left_out(), LeftOut { n_damaged: 3, n_short: 2 });
}

#[test]
fn a_camera_of_which_no_frame_is_whole_does_not_hold_the_loop() {
    let plug = depth_camera();
    let short = |number| Event::Frame(Sent { bytes: Vec::new(), ..sent(number) });
    plug.borrow_mut().events.extend((0..1000).map(short));
    let mut camera = shim_of(&plug, None);
    while camera.left_out().n_short < 1000 {
        // Whatever time it has.
        assert_eq!(camera.read(&mut [0; 6], Duration::ZERO).unwrap(), Reading::NotYet);
    }
}

#[test]
fn an_unplugged_camera_is_waited_for_and_each_is_told_once() {
    let plug = depth_camera();
    plug.borrow_mut().events.extend([frame(0), frame(1), Event::WaitFails(Errno::NODEV)]);
    let mut camera = shim_of(&plug, None);
    assert_eq!(read(&mut camera, 2).1, [""; 0]);
    // While it is away, and when it is back but not yet ours.
    plug.borrow_mut().open_fails.extend([Errno::NOENT, Errno::ACCESS]);
    plug.borrow_mut().events.extend([frame(3), frame(4)]);
    let (frames, news) = read(&mut camera, 2);
    assert_eq!(
        news,
        ["/dev/video0 cannot be read: it is not there; waiting until it can", "/dev/video0 can be read"]
    );
    let sequences: Vec<u64> = frames.iter().map(|(frame, _)| frame.sequence).collect();
    assert_eq!(sequences, [2, 3], "a new stream's first number says nothing of losses");
    assert_eq!((plug.borrow().n_opened, plug.borrow().n_open), (2, 1));
    drop(camera);
    assert_eq!(plug.borrow().n_open, 0);
}

#[test]
fn a_call_that_fails_anywhere_in_a_stream_ends_it_and_the_next_goes_on() {
    let check = |fails: Event, expected: &[u32]| {
        let plug = depth_camera();
        plug.borrow_mut().events.extend([frame(0), frame(1), fails, frame(2), frame(3)]);
        let mut camera = shim_of(&plug, None);
        let (frames, news) = read(&mut camera, expected.len());
        assert!(frames.is_sorted_by(|(one, _), (next, _)| one.sequence < next.sequence));
        let counts: Vec<Vec<u16>> = frames.into_iter().map(|(_, counts)| counts).collect();
        assert_eq!(counts, expected.iter().map(|number| counts_of(*number)).collect::<Vec<_>>());
        assert_eq!(news.len(), 2, "{news:?}");
        assert_eq!((plug.borrow().n_opened, plug.borrow().n_open), (2, 1));
    };
    for errno in [Errno::NODEV, Errno::IO] {
        check(Event::WaitFails(errno), &[0, 1, 2, 3]);
        check(Event::DequeueFails(errno), &[0, 1, 2, 3]);
        // The frame whose buffer cannot be given back goes with the stream.
        check(Event::QueueFails(errno), &[0, 2, 3]);
    }
}

#[test]
fn why_a_camera_is_waited_for_is_said_in_words() {
    for (errno, words) in [
        (Errno::NOENT, "it is not there"),
        (Errno::ACCESS, "this user may not; it must be in the group video"),
        (Errno::PERM, "this user may not; it must be in the group video"),
        (Errno::BUSY, "another program reads it"),
        (Errno::IO, "Input/output error (os error 5)"),
    ] {
        let plug = depth_camera();
        plug.borrow_mut().open_fails.extend([errno]);
        let mut camera = shim_of(&plug, None);
        assert_eq!(camera.read(&mut [0; 6], TICK).unwrap(), Reading::NotYet);
        let expected = format!("/dev/video0 cannot be read: {words}; waiting until it can");
        assert_eq!(camera.news(), Some(expected.clone()));
        assert_eq!(camera.news(), None);
        // Another program may have it only once it streams.
        let plug = depth_camera();
        plug.borrow_mut().set_format_fails = Some(errno);
        let mut camera = shim_of(&plug, None);
        assert_eq!(camera.read(&mut [0; 6], TICK).unwrap(), Reading::NotYet);
        assert_eq!(camera.news(), Some(expected));
        assert_eq!(plug.borrow().n_open, 0);
    }
    let plug = depth_camera();
    plug.borrow_mut().n_buffers = 0;
    let mut camera = shim_of(&plug, None);
    assert_eq!(camera.read(&mut [0; 6], TICK).unwrap(), Reading::NotYet);
    assert!(camera.news().unwrap().contains("its driver has no memory for frames"));
}

#[test]
fn another_camera_in_its_place_is_told_and_waited_out() {
    let plug = depth_camera();
    plug.borrow_mut().events.extend([frame(0), Event::WaitFails(Errno::NODEV)]);
    let mut camera = shim_of(&plug, None);
    read(&mut camera, 1);
    plug.borrow_mut().formats = vec![*b"YUYV"];
    let mut news = Vec::new();
    let until = Instant::now() + DEADLINE;
    while plug.borrow().n_opened < 4 {
        assert!(Instant::now() < until);
        assert_eq!(camera.read(&mut [0; 6], TICK).unwrap(), Reading::NotYet);
        news.extend(std::iter::from_fn(|| camera.news()));
    }
    plug.borrow_mut().formats = vec![*b"Z16 "];
    plug.borrow_mut().events.push_back(frame(0));
    news.extend(read(&mut camera, 1).1);
    assert_eq!(
        news,
        [
            "/dev/video0 cannot be read: it is not there; waiting until it can",
            "/dev/video0 sends YUYV; only Z16 and Y16 can be read (a camera may have another device file for depth); \
             waiting for the right one",
            "/dev/video0 can be read"
        ]
    );
}

#[test]
fn silence_and_wakes_for_nothing_are_no_frames_and_no_end() {
    let plug = depth_camera();
    plug.borrow_mut().events.extend([Event::Silence, Event::Spurious, frame(0)]);
    let mut camera = shim_of(&plug, None);
    let mut counts = [0; 6];
    assert_eq!(camera.read(&mut counts, TICK).unwrap(), Reading::NotYet);
    assert_eq!(camera.read(&mut counts, TICK).unwrap(), Reading::NotYet);
    let (frames, news) = read(&mut camera, 1);
    assert_eq!((frames[0].1.clone(), news), (counts_of(0), vec![]));
}

#[test]
fn frames_have_the_time_of_their_capture_by_the_wall_clock() {
    let plug = depth_camera();
    let now_ns = monotonic_ns() as i64;
    let at = |number, age_us: i64| {
        let (timestamp_s, timestamp_us) =
            ((now_ns / 1000 - age_us) / 1_000_000, (now_ns / 1000 - age_us) % 1_000_000);
        Event::Frame(Sent { timestamp_s, timestamp_us, ..sent(number) })
    };
    let without_clock = Event::Frame(Sent { flags: 0, timestamp_s: 3, ..sent(2) });
    plug.borrow_mut().events.extend([at(0, 2_000_000), at(1, 1_999_999), without_clock]);
    let before_ns = ns_since_epoch();
    let (frames, _) = read(&mut shim_of(&plug, None), 3);
    let after_ns = ns_since_epoch();
    let [first, second, third] = [0, 1, 2].map(|index| frames[index].0.capture.captured.0);
    assert_eq!(second - first, 1000);
    // Two seconds before a moment that lies a little before this test's first look at the clock.
    let age_ns = before_ns - first;
    assert!((1_900_000_000..=2_100_000_000).contains(&age_ns), "{age_ns}");
    assert!((before_ns..=after_ns).contains(&third));
}

#[test]
fn a_rate_is_asked_for_and_another_one_told() {
    for (interval, told) in [
        (Some((1, 30)), None),
        (Some((333_333, 10_000_000)), None),
        (Some((1, 15)), Some("/dev/video0 does not send 30 frames a second, but 15.0")),
        (None, Some("/dev/video0 does not send 30 frames a second, but as many as its driver likes")),
    ] {
        let plug = depth_camera();
        plug.borrow_mut().interval = interval;
        plug.borrow_mut().events.extend([frame(0), Event::WaitFails(Errno::NODEV), frame(0)]);
        let (_, news) = read(&mut shim_of(&plug, Some(30)), 2);
        assert_eq!(plug.borrow().rate_asked_for, Some((1, 30)));
        let about_rates: Vec<&String> = news.iter().filter(|news| news.contains("a second")).collect();
        assert_eq!(about_rates, Vec::from_iter(told), "also when it comes back");
    }
    let plug = depth_camera();
    plug.borrow_mut().events.push_back(frame(0));
    read(&mut shim_of(&plug, None), 1);
    assert_eq!(plug.borrow().rate_asked_for, None);
}

fn event() -> impl Strategy<Value = Event> {
    let bytes = proptest::collection::vec(any::<u8>(), 0..=64);
    let frame = (any::<u32>(), bytes, any::<u32>(), any::<i64>(), any::<i64>()).prop_map(
        |(number, bytes, flags, timestamp_s, timestamp_us)| {
            Event::Frame(Sent { number, bytes, flags, timestamp_s, timestamp_us })
        },
    );
    prop_oneof![8 => frame, 1 => Just(Event::Spurious), 1 => Just(Event::Silence)]
}

proptest! {
    #[test]
    fn whatever_a_driver_does_whole_frames_come_in_rising_numbers(
        events in proptest::collection::vec(event(), 0..60),
        margin_bytes in 0_u32..20,
    ) {
        let plug = depth_camera();
        plug.borrow_mut().margin_bytes = margin_bytes;
        plug.borrow_mut().events.extend(events.iter().cloned());
        let mut camera = shim_of(&plug, None);
        let stride = 6 + margin_bytes as usize;
        let mut sequence = None;
        let mut came = Vec::new();
        let mut counts = [0; 6];
        while !plug.borrow().events.is_empty() {
            if let Reading::Numbered(frame) = camera.read(&mut counts, Duration::ZERO).unwrap() {
                prop_assert!(sequence.is_none_or(|sequence| frame.sequence > sequence));
                sequence = Some(frame.sequence);
                came.push(counts.to_vec());
            }
        }
        // The plain way: a count at a time, from where its row begins.
        let sent = events.iter().filter_map(|event| match event {
            Event::Frame(Sent { bytes, flags, .. }) if flags & DAMAGED == 0 && bytes.len() >= stride + 6 => {
                let count = |index: usize| {
                    let at = index / 3 * stride + index % 3 * 2;
                    u16::from(bytes[at]) + 256 * u16::from(bytes[at + 1])
                };
                Some((0..6).map(count).collect::<Vec<u16>>())
            }
            _ => None,
        });
        prop_assert_eq!(came, sent.collect::<Vec<_>>());
    }
}

#[test]
fn addresses_of_cameras_are_read_as_they_are_written_or_refused_in_words() {
    for text in ["v4l2:///dev/video0", "v4l2:///dev/v4l/by-id/usb-depth-index0?rate_hz=30"] {
        assert_eq!(text.parse::<DeviceAddress>().unwrap().to_string(), text);
    }
    for text in [
        "v4l2://",
        "v4l2://video0",
        "v4l2:///dev/video0?rate_hz=0",
        "v4l2:///dev/video0?rate_hz=1001",
        "v4l2:///dev/video0?rate=30",
        "v4l:///dev/video0",
    ] {
        let refused = text.parse::<DeviceAddress>();
        assert_eq!(refused, Err(AddressError { text: text.to_string() }));
    }
}

#[test]
fn what_is_no_video_device_is_refused_by_the_systems_own_answer() {
    let camera =
        |path: &str| DepthCamera::new(CameraAddress { path: path.into(), rate_hz: None }, LAYOUT).unwrap();
    let error = camera("/dev/null").read(&mut [0; 6], TICK).unwrap_err();
    assert!(error.to_string().starts_with("/dev/null sends no pictures; "), "{error}");
    let mut absent = camera("/dev/there-is-no-such-camera");
    assert_eq!(absent.read(&mut [0; 6], TICK).unwrap(), Reading::NotYet);
    let said = "/dev/there-is-no-such-camera cannot be read: it is not there; waiting until it can";
    assert_eq!(absent.news().as_deref(), Some(said));
}

#[test]
fn a_virtual_camera_of_the_kernel_sends_frames() {
    let is_vivid = |path: &String| {
        let capability = KernelDevice::open(path.as_ref()).and_then(|mut device| device.capability());
        capability.is_ok_and(|capability| {
            capability.driver.starts_with(b"vivid") && capability.device_capabilities & CAN_CAPTURE != 0
        })
    };
    let Some(path) = (0..64).map(|index| format!("/dev/video{index}")).find(is_vivid) else {
        eprintln!("skipped: the kernel has no virtual camera (modprobe vivid)");
        return;
    };
    let layout = FrameLayout { rows: 360, columns: 640, metres_per_count: 0.001 };
    let mut camera =
        DepthCamera::new(CameraAddress { path: path.into(), rate_hz: Some(15) }, layout).unwrap();
    let mut counts = vec![0; layout.n_readings()];
    let mut frames: Vec<NumberedFrame> = Vec::new();
    let until = Instant::now() + DEADLINE;
    while frames.len() < 10 {
        assert!(Instant::now() < until, "{:?}", camera.news());
        if let Reading::Numbered(frame) = camera.read(&mut counts, TICK).unwrap() {
            frames.push(frame);
            assert!(counts.iter().any(|count| *count != counts[0]), "a picture has more than one colour");
        }
    }
    assert!(frames.is_sorted_by(|one, next| {
        one.sequence < next.sequence && one.capture.captured < next.capture.captured
    }));
    let age_ns = ns_since_epoch() - frames[9].capture.captured.0;
    assert!((0..DEADLINE.as_nanos() as i64).contains(&age_ns), "{age_ns}");
}
