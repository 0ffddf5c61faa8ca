//! The template of a shim of one's own works, and is the one that the documents show.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use kinds_messages::{FrameReader, Node, OwnDomain};

#[path = "../examples/custom_shim.rs"]
#[allow(dead_code, reason = "a program's, whose main is not called here")]
mod custom_shim;

#[test]
fn a_shim_of_ones_own_publishes_what_its_device_reads() {
    let domain = OwnDomain::make().unwrap();
    let stop = AtomicBool::new(false);
    let node = Node::open(&domain, "test").unwrap();
    let sensor = "crunch/ring".parse().unwrap();
    let reader = FrameReader::open(&node, &sensor).unwrap();
    std::thread::scope(|scope| {
        let shim = scope.spawn(|| custom_shim::publish(&domain, "crunch/ring", &stop).unwrap());
        let until = Instant::now() + Duration::from_secs(20);
        let mut frames: Vec<(u64, Vec<u16>)> = Vec::new();
        while frames.len() < 3 && Instant::now() < until && !shim.is_finished() {
            reader.wait(Duration::from_millis(50)).unwrap();
            while let Some(frame) = reader.receive().unwrap() {
                frames.push((frame.header().sequence, frame.counts().to_vec()));
            }
        }
        stop.store(true, Ordering::Relaxed);
        assert!(frames.len() >= 3, "{frames:?}");
        for (sequence, counts) in frames {
            assert_eq!(counts, [sequence as u16 + 1; 16]);
        }
    });
}

#[test]
fn the_documents_show_the_template_as_it_is() {
    let page = include_str!("../../docs/devices.md");
    let template = include_str!("../examples/custom_shim.rs");
    assert!(page.contains(&format!("```rust\n{template}```\n")));
}
