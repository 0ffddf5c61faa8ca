//! The template of a shim of one's own works, and is the one that the documents show.

use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use kinds_messages::{FrameReader, Node, OwnDomain};

#[path = "../examples/custom_shim.rs"]
mod custom_shim;

/// The template's program, which another test starts as a process of its own.
#[test]
#[ignore = "it goes on for ever"]
fn template() {
    custom_shim::main().unwrap();
}

#[test]
fn a_shim_of_ones_own_publishes_what_its_device_reads() {
    let domain = OwnDomain::make().unwrap();
    let node = Node::open(&domain, "test").unwrap();
    let reader = FrameReader::open(&node, &"crunch/ring".parse().unwrap()).unwrap();
    let mut shim = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "template", "--ignored"])
        .env("KINDS_DOMAIN", &domain.root)
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let until = Instant::now() + Duration::from_secs(20);
    let mut frames: Vec<(u64, Vec<u16>)> = Vec::new();
    while frames.len() < 3 && Instant::now() < until {
        assert_eq!(shim.try_wait().unwrap(), None, "it goes on for ever");
        reader.wait(Duration::from_millis(50)).unwrap();
        while let Some(frame) = reader.receive().unwrap() {
            frames.push((frame.header().sequence, frame.counts().to_vec()));
        }
    }
    shim.kill().and_then(|()| shim.wait()).unwrap();
    node.clean_up_dead_nodes();
    assert!(frames.len() >= 3, "{frames:?}");
    for (sequence, counts) in frames {
        assert_eq!(counts, [sequence as u16 + 1; 16]);
    }
}

#[test]
fn the_template_is_short_and_the_documents_show_it_as_it_is() {
    let page = include_str!("../../docs/devices.md");
    let template = include_str!("../examples/custom_shim.rs");
    let n_lines = template.lines().filter(|line| !line.is_empty()).count();
    assert!(n_lines <= 20, "{n_lines} lines");
    assert!(page.contains(&format!("```rust\n{template}```\n")));
}
