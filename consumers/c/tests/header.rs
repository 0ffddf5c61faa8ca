//! The header that C programs include is what this library's sources give.

use std::path::Path;

#[test]
fn header_is_what_the_sources_give() {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let messages = here.join("../../messages/src");
    let made = cbindgen::Builder::new()
        .with_config(cbindgen::Config::from_file(here.join("cbindgen.toml")).unwrap())
        .with_src(messages.join("frame_header.rs"))
        .with_src(messages.join("kind_report.rs"))
        .with_src(here.join("src/call.rs"))
        .with_src(here.join("src/member.rs"))
        .with_src(here.join("src/reports.rs"))
        .with_src(here.join("src/frames.rs"))
        .with_src(here.join("src/publisher.rs"))
        .generate()
        .unwrap();
    let mut text = Vec::new();
    made.write(&mut text);
    let text = String::from_utf8(text).unwrap();
    let path = here.join("include/natural_kinds.h");
    if std::env::var_os("KINDS_BLESS").is_some() {
        std::fs::write(&path, &text).unwrap();
    }
    let committed = std::fs::read_to_string(&path).unwrap();
    assert!(committed == text, "{} is of other sources; KINDS_BLESS=1 makes it anew", path.display());
}
