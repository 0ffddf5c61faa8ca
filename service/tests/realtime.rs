//! From receiving a frame to the sent report, a service that polls calls nothing that may wait: no memory is asked for, no file, lock or
//! socket is touched, but for the transport's loan of the next report. RealtimeSanitizer watches, where this program was linked with it
//! (`service/tests/sanitize`). What it does not see are locks that nobody else holds.
#![allow(unsafe_code, reason = "the sanitizer is told by functions of C, and an allocator tells it")]
#![allow(clippy::print_stderr, reason = "a test that is skipped says so")]

#[cfg(rtsan)]
mod trained;

#[cfg(not(rtsan))]
#[test]
fn a_service_that_polls_never_waits_between_a_frame_and_its_report() {
    eprintln!("skipped: not linked with RealtimeSanitizer; service/tests/sanitize does that");
}

#[cfg(rtsan)]
mod sanitized {
    use std::alloc::{GlobalAlloc, Layout, System};
    use std::cell::Cell;
    use std::fs::File;
    use std::hint::black_box;
    use std::process::Command;
    use std::sync::atomic::AtomicBool;

    use kinds_messages::{FrameHeader, FramePublisher, Node, OwnDomain, ReportReader, ReportStatus, Waiting};
    use kinds_model::SensorLayout;
    use kinds_service::Service;

    use crate::trained::{LOAN_BYTES, N_FRAMES, classifier, trip};

    // SAFETY: these are the sanitizer's, and take nothing.
    unsafe extern "C" {
        safe fn __rtsan_init();
        safe fn __rtsan_realtime_enter();
        safe fn __rtsan_realtime_exit();
    }

    thread_local! {
        static IS_WATCHED: Cell<bool> = const { Cell::new(false) };
    }

    /// Does something that must not wait.
    fn watched<T>(act: impl FnOnce() -> T) -> T {
        __rtsan_realtime_enter();
        IS_WATCHED.set(true);
        let done = act();
        IS_WATCHED.set(false);
        __rtsan_realtime_exit();
        done
    }

    /// The system's allocator, of which the transport may have that one piece.
    struct But;

    #[global_allocator]
    static ALLOCATOR: But = But;

    /// Does something that is not looked at, if it is for a loan.
    fn unseen<T>(layout: Layout, act: impl FnOnce() -> T) -> T {
        if layout.size() != LOAN_BYTES || !IS_WATCHED.get() {
            return act();
        }
        __rtsan_realtime_exit();
        let done = act();
        __rtsan_realtime_enter();
        done
    }

    // SAFETY: all is left to the system's allocator.
    unsafe impl GlobalAlloc for But {
        unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
            // SAFETY: the caller keeps to the same contract.
            unseen(layout, || unsafe { System.alloc(layout) })
        }

        unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
            // SAFETY: the caller keeps to the same contract.
            unseen(layout, || unsafe { System.dealloc(memory, layout) });
        }
    }

    #[test]
    fn a_service_that_polls_never_waits_between_a_frame_and_its_report() {
        __rtsan_init();
        for (rows, columns) in [(1, 16), (124, 160)] {
            let sensor = SensorLayout { rows, columns, metres_per_count: 0.001 };
            let domain = OwnDomain::make().unwrap();
            let node = Node::open(&domain, "test").unwrap();
            let name = "crunch/ring".parse().unwrap();
            let mut service =
                Service::start_with(&node, &name, classifier(sensor), Waiting::Polling).unwrap();
            let reports = ReportReader::open_with(&node, &name, Waiting::Polling).unwrap();
            let shim = FramePublisher::create(&node, &name, sensor.n_readings()).unwrap();
            let stop = AtomicBool::new(true);
            let trip = trip(sensor, N_FRAMES);
            for (sequence, counts) in (0..).zip(trip.chunks_exact(sensor.n_readings())) {
                let header = FrameHeader {
                    run: 7,
                    sequence,
                    rows,
                    columns,
                    metres_per_count: 0.001,
                    ..FrameHeader::default()
                };
                let mut loan = shim.loan().unwrap();
                loan.counts_mut().copy_from_slice(counts);
                loan.send(&header).unwrap();
                // The first frames connect publishers and readers.
                let served = if sequence < 3 { service.run(&stop) } else { watched(|| service.run(&stop)) };
                served.unwrap();
                let report = reports.receive().unwrap().unwrap();
                assert_eq!((report.sequence, report.status()), (sequence, ReportStatus::Classified));
            }
        }
    }

    /// Set for a process of this program that is to be caught.
    const OFFENCE: &str = "KINDS_TEST_OFFENCE";

    #[test]
    fn the_sanitizer_catches_memory_and_files() {
        __rtsan_init();
        match std::env::var(OFFENCE).as_deref() {
            Ok("memory") => watched(|| drop(black_box(Vec::<u8>::with_capacity(1000)))),
            Ok("file") => watched(|| drop(black_box(File::open("/")))),
            _ => {
                for (offence, said) in [("memory", "malloc"), ("file", "close")] {
                    let caught = Command::new(std::env::current_exe().unwrap())
                        .args(["--exact", "sanitized::the_sanitizer_catches_memory_and_files", "--nocapture"])
                        .env(OFFENCE, offence)
                        .output()
                        .unwrap();
                    let told = String::from_utf8_lossy(&caught.stderr);
                    assert!(
                        !caught.status.success() && told.contains(&format!("unsafe function `{said}`")),
                        "{offence}: {told}"
                    );
                }
            }
        }
    }
}
