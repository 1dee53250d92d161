//! Notes where the Rust toolchain lies, for the Python extension.
//!
//! A toolchain of rustup brings a libLLVM that Dr.Jit can use. The extension knows where the one that built it lies, so
//! that the fast renderer works on a machine that has Rust and no other LLVM, also where `rustc` is not on the path.

use std::env;
use std::process::Command;

fn main() {
    println!("cargo::rerun-if-changed=rust/build.rs");
    println!("cargo::rerun-if-env-changed=RUSTC");
    println!("cargo::rerun-if-env-changed=RUSTUP_TOOLCHAIN");
    if env::var_os("CARGO_FEATURE_PYTHON").is_none() {
        return;
    }
    println!("cargo::rustc-env=DAVIS_RS_RUST_SYSROOT={}", sysroot());
}

/// What `rustc --print sysroot` says; empty where it cannot be asked, which leaves Python the usual places to look in.
fn sysroot() -> String {
    let rustc = env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let asked = Command::new(rustc).args(["--print", "sysroot"]).output();
    asked
        .ok()
        .filter(|output| output.status.success())
        .and_then(|output| String::from_utf8(output.stdout).ok())
        .map(|path| path.trim().to_owned())
        .unwrap_or_default()
}
