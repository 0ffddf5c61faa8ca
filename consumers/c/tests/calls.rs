//! What C programs call, called as they would: the way of a frame and a report, and every refusal.

#![allow(unsafe_code, reason = "it calls what C calls")]

use std::ffi::{CStr, CString, c_char};
use std::ptr::{null, null_mut};

use kinds_messages::{FrameHeader, KindReport, Node, OwnDomain, ReportPublisher};
use natural_kinds::*;

/// Nothing here takes nearly as long.
const LONG_MS: u32 = 60_000;
const SENSOR: *const c_char = c"crunch/ring".as_ptr();

fn last_error() -> String {
    // SAFETY: it ends with a zero, and no call fails meanwhile.
    unsafe { CStr::from_ptr(kinds_last_error()) }.to_str().unwrap().to_owned()
}

fn folder(domain: &OwnDomain) -> CString {
    CString::new(domain.root.to_str().unwrap()).unwrap()
}

fn no_frame() -> kinds_frame {
    kinds_frame { header: null(), counts: null(), n_readings: 0 }
}

fn no_loan() -> kinds_loan {
    kinds_loan { header: FrameHeader::default(), counts: null_mut(), n_readings: 0 }
}

fn report(sequence: u64, kind: u32) -> KindReport {
    let mut report = KindReport::default();
    (report.sequence, report.kind) = (sequence, kind);
    report
}

#[test]
fn a_frame_goes_from_a_borrowed_slot_to_a_reader_with_its_header() {
    let domain = OwnDomain::make().unwrap();
    let folder = folder(&domain);
    let (mut loan, mut frame) = (no_loan(), no_frame());
    // SAFETY: handles are open until they are closed, and places are there.
    unsafe {
        let frames = kinds_frames_open(SENSOR, folder.as_ptr(), KINDS_BY_EVENT);
        let publisher = kinds_publisher_open(SENSOR, folder.as_ptr(), 2, 3, 0.001);
        assert!(!frames.is_null() && !publisher.is_null(), "{}", last_error());
        assert_eq!(kinds_publisher_n_readers(publisher), 1);
        assert_eq!(kinds_frames_next(frames, 0, &mut frame), KINDS_NOTHING);
        for sequence in [0, 1, 7] {
            assert_eq!(kinds_publisher_borrow(publisher, &mut loan), 0, "{}", last_error());
            std::slice::from_raw_parts_mut(loan.counts, loan.n_readings).copy_from_slice(&[
                1,
                2,
                3,
                4,
                5,
                sequence as u16,
            ]);
            assert_eq!(loan.header.sequence, sequence.min(2));
            loan.header.sequence = sequence;
            // What the sensor is cannot be changed by the way.
            loan.header.rows = 9;
            loan.header.captured_ns = -5;
            assert_eq!(kinds_publisher_send(publisher, &loan), 0, "{}", last_error());
            assert_eq!(kinds_frames_next(frames, LONG_MS, &mut frame), KINDS_RECEIVED);
            let counts = std::slice::from_raw_parts(frame.counts, frame.n_readings);
            assert_eq!(counts, [1, 2, 3, 4, 5, sequence as u16]);
            let header = &*frame.header;
            assert_eq!((header.sequence, header.captured_ns), (sequence, -5));
            assert_eq!((header.rows, header.columns, header.metres_per_count), (2, 3, 0.001));
            assert_eq!(header.version, FrameHeader::VERSION);
            assert!(header.run > 0 && header.sent_monotonic_ns > 0);
            assert_eq!(kinds_frames_release(frames, &frame), 0);
        }
        assert_eq!(kinds_publisher_update(publisher), 0);
        kinds_publisher_close(publisher);
        kinds_frames_close(frames);
    }
}

#[test]
fn what_is_lent_is_given_back_once_and_two_frames_can_be_held() {
    let domain = OwnDomain::make().unwrap();
    let folder = folder(&domain);
    let (mut loan, mut other) = (no_loan(), no_loan());
    let mut held = [no_frame(), no_frame(), no_frame()];
    // SAFETY: handles are open until they are closed, and places are there.
    unsafe {
        let frames = kinds_frames_open(SENSOR, folder.as_ptr(), KINDS_BY_EVENT);
        let publisher = kinds_publisher_open(SENSOR, folder.as_ptr(), 1, 4, 0.001);
        assert_eq!(kinds_publisher_borrow(publisher, &mut loan), 0);
        assert_eq!(kinds_publisher_borrow(publisher, &mut other), KINDS_ERROR);
        assert!(last_error().contains("natural-kinds/crunch/ring/frames"), "{}", last_error());
        assert_eq!(kinds_publisher_give_back(publisher, &loan), 0);
        let gone = "the frame was not borrowed through this handle, or is sent or given back already";
        assert_eq!(kinds_publisher_give_back(publisher, &loan), KINDS_ERROR);
        assert_eq!(last_error(), gone);
        for _ in 0..3 {
            assert_eq!(kinds_publisher_borrow(publisher, &mut loan), 0);
            assert_eq!(kinds_publisher_send(publisher, &loan), 0);
            assert_eq!(kinds_publisher_send(publisher, &loan), KINDS_ERROR);
            assert_eq!(last_error(), gone);
        }
        assert_eq!(kinds_frames_next(frames, LONG_MS, &mut held[0]), KINDS_RECEIVED);
        assert_eq!(kinds_frames_next(frames, LONG_MS, &mut held[1]), KINDS_RECEIVED);
        assert_eq!(kinds_frames_next(frames, 0, &mut held[2]), KINDS_ERROR);
        assert!(last_error().contains("natural-kinds/crunch/ring/frames"), "{}", last_error());
        assert_eq!(kinds_frames_release(frames, &held[0]), 0);
        assert_eq!(kinds_frames_release(frames, &held[0]), KINDS_ERROR);
        assert_eq!(last_error(), "the frame was not received through this handle, or is released already");
        assert_eq!(kinds_frames_next(frames, LONG_MS, &mut held[2]), KINDS_RECEIVED);
        assert_eq!([(*held[1].header).sequence, (*held[2].header).sequence], [1, 2]);
        // With a loan and two frames still out.
        assert_eq!(kinds_publisher_borrow(publisher, &mut loan), 0);
        kinds_publisher_close(publisher);
        kinds_frames_close(frames);
    }
}

#[test]
fn a_report_is_read_in_place_by_event_and_by_polling_until_the_next_is_asked_for() {
    let domain = OwnDomain::make().unwrap();
    let folder = folder(&domain);
    let node = Node::open(&domain, "test").unwrap();
    for waiting in [KINDS_BY_EVENT, KINDS_POLLING] {
        let service = ReportPublisher::create(&node, &"crunch/ring".parse().unwrap()).unwrap();
        let mut place: *const KindReport = null();
        // SAFETY: handles are open until they are closed, and places are there.
        unsafe {
            let reports = kinds_reports_open(SENSOR, folder.as_ptr(), waiting);
            assert!(!reports.is_null(), "{}", last_error());
            assert_eq!(kinds_reports_is_served(reports), 1);
            for sequence in 0..3 {
                let mut report = report(sequence, 1);
                report.set_probabilities(&[0.25, 0.75], &[0.5, 0.5]);
                service.send(&report).unwrap();
                assert_eq!(kinds_reports_next(reports, LONG_MS, &mut place), KINDS_RECEIVED);
                assert_eq!(((*place).sequence, (*place).probabilities()), (sequence, &[0.25, 0.75][..]));
            }
            assert_eq!(kinds_reports_next(reports, 1, &mut place), KINDS_NOTHING);
            assert!(place.is_null());
            service.send(&report(3, 64)).unwrap();
            assert_eq!(kinds_reports_next(reports, LONG_MS, &mut place), KINDS_ERROR);
            assert_eq!(
                last_error(),
                "a service sent a report whose kind or lengths reach beyond its end; run all programs in the same version"
            );
            assert_eq!(kinds_reports_release(reports), 0);
            drop(service);
            assert_eq!(kinds_reports_is_served(reports), 0);
            kinds_reports_close(reports);
        }
    }
}

#[test]
fn fewer_kinds_are_written_where_there_is_a_place_for_them() {
    let mut report = report(0, 1);
    report.set_kinds([0, 1, 5].into_iter(), [(0, 2), (0, 1)].into_iter());
    report.set_probabilities(&[0.25, 0.5, 0.25], &[0.5, 0.125, 0.375]);
    let (mut probabilities, mut filtered, mut groups) = ([-1.0; 64], [-1.0; 64], [9; 64]);
    // SAFETY: places are NULL or have room.
    unsafe {
        let [p, f] = [probabilities.as_mut_ptr(), filtered.as_mut_ptr()];
        assert_eq!(kinds_report_at_level(&report, 2, p, f, null_mut()), 2);
        assert_eq!(kinds_report_at_level(&report, 9, null_mut(), null_mut(), groups.as_mut_ptr()), 3);
        assert_eq!(kinds_report_at_level(&report, 0, null_mut(), null_mut(), null_mut()), 1);
        assert_eq!(kinds_report_at_level(null(), 2, p, f, null_mut()), KINDS_ERROR);
    }
    assert_eq!(last_error(), "the report is NULL; give one");
    assert_eq!((&probabilities[..3], &filtered[..3]), (&[0.5, 0.5, -1.0][..], &[0.875, 0.125, -1.0][..]));
    assert_eq!(groups[..4], [0, 1, 2, 9]);
}

#[test]
fn what_cannot_be_is_refused_in_words() {
    let domain = OwnDomain::make().unwrap();
    let folder = folder(&domain);
    let refused = |is_refused: bool, sentence: &str| {
        assert!(is_refused, "{sentence}");
        assert_eq!(last_error(), sentence);
    };
    let mut place: *const KindReport = null();
    // SAFETY: what is not NULL is there.
    unsafe {
        let folder = folder.as_ptr();
        refused(kinds_reports_open(null(), folder, 0).is_null(), "the sensor's name is NULL; give one");
        refused(
            kinds_reports_open(c"a b".as_ptr(), folder, 0).is_null(),
            "sensor name \"a b\" has the character ' '; only letters A-Z and a-z, digits, '_', '.' and '-' may be used, \
             and '/' between parts",
        );
        let not_text = c"\xff".as_ptr();
        refused(kinds_reports_open(not_text, folder, 0).is_null(), "the sensor's name is not text in UTF-8");
        refused(kinds_reports_open(SENSOR, not_text, 0).is_null(), "the domain is not text in UTF-8");
        refused(
            kinds_reports_open(SENSOR, c"kinds".as_ptr(), 0).is_null(),
            "channels cannot live under kinds: programs started in other folders would not find them; give the root as \
             an absolute path",
        );
        refused(
            kinds_frames_open(SENSOR, folder, 2).is_null(),
            "waiting is 2; give 0 (by event) or 1 (polling)",
        );
        refused(kinds_reports_next(null_mut(), 0, &mut place) == KINDS_ERROR, "the handle is NULL; give one");
        let reports = kinds_reports_open(SENSOR, folder, 0);
        refused(
            kinds_reports_next(reports, 0, null_mut()) == KINDS_ERROR,
            "the place for the report is NULL; give one",
        );
        kinds_reports_close(reports);
        kinds_reports_close(null_mut());
        for (rows, columns, metres_per_count, said) in
            [(0, 16, 0.001, "0 × 16 readings of 0.001 m"), (1, 16, f64::NAN, "1 × 16 readings of NaN m")]
        {
            refused(
                kinds_publisher_open(SENSOR, folder, rows, columns, metres_per_count).is_null(),
                &format!(
                    "a sensor of {said} each count cannot be; all must be above 0, and the readings at most 67108864"
                ),
            );
        }
    }
}

#[test]
fn a_handle_may_move_to_another_thread_and_two_at_once_are_refused() {
    struct Moved(*mut kinds_reports);
    // SAFETY: a handle may be handed to another thread, and the test says which errors two at once get.
    unsafe impl Send for Moved {}
    let domain = OwnDomain::make().unwrap();
    let folder = folder(&domain);
    let node = Node::open(&domain, "test").unwrap();
    let service = ReportPublisher::create(&node, &"crunch/ring".parse().unwrap()).unwrap();
    // SAFETY: the handle is open until it is closed, and places are there.
    unsafe {
        let reports = kinds_reports_open(SENSOR, folder.as_ptr(), KINDS_BY_EVENT);
        let moved = Moved(reports);
        let waiting = std::thread::spawn(move || {
            let moved = moved;
            let mut place: *const KindReport = null();
            let came = kinds_reports_next(moved.0, LONG_MS, &mut place);
            (came, (*place).sequence)
        });
        // Until the other thread is inside.
        while kinds_reports_is_served(reports) != KINDS_ERROR {
            std::thread::yield_now();
        }
        assert_eq!(
            last_error(),
            "the handle is in use by another thread; let one thread at a time use it, or open another one"
        );
        service.send(&report(7, 0)).unwrap();
        assert_eq!(waiting.join().unwrap(), (KINDS_RECEIVED, 7));
        kinds_reports_close(reports);
    }
}
