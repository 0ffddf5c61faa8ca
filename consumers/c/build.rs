//! Names the shared library for the loader: programs that are linked with one version of the ABI do not start with another.
#![allow(clippy::print_stdout, reason = "this is how a build script speaks to cargo")]

use std::path::{Path, PathBuf};

fn main() {
    let soname = soname();
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rustc-cdylib-link-arg=-Wl,-soname,{soname}");
    // So that programs find it where cargo builds it, too; elsewhere the package, or ldconfig, makes this link.
    let out = PathBuf::from(variable("OUT_DIR"));
    let built = out.ancestors().nth(3).expect("it is PROFILE/build/PACKAGE/out");
    for folder in [built, &built.join("deps")] {
        link(&folder.join(&soname));
    }
}

/// Until 1.0 the ABI is that of the minor version, as for cargo.
fn soname() -> String {
    let (major, minor) = (variable("CARGO_PKG_VERSION_MAJOR"), variable("CARGO_PKG_VERSION_MINOR"));
    match major.as_str() {
        "0" => format!("libnatural_kinds.so.0.{minor}"),
        _ => format!("libnatural_kinds.so.{major}"),
    }
}

fn link(path: &Path) {
    match std::os::unix::fs::symlink("libnatural_kinds.so", path) {
        Err(error) if error.kind() != std::io::ErrorKind::AlreadyExists => {
            panic!("cannot make the link {}: {error}", path.display())
        }
        _ => {}
    }
}

fn variable(name: &str) -> String {
    std::env::var(name).unwrap_or_else(|_| panic!("cargo sets {name}"))
}
