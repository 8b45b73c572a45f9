//! A library with the functions of Open Image Denoise that are used, for tests of what happens around it: it filters
//! nothing, and fails when it is told to. `tests/denoisers.rs` compiles it.
//!
//! `OIDN_STUB` says what it does: `version-3`, `no-memory`, `fault`; `--cfg version_1` leaves out what version 1 lacks.
#![allow(non_snake_case)]

use std::ffi::{CStr, c_char, c_int, c_void};
use std::sync::Mutex;

/// Images that were set last: read, written, and how many numbers they have.
static IMAGES: Mutex<[usize; 3]> = Mutex::new([0; 3]);
/// Whether a filter was executed.
static EXECUTED: Mutex<bool> = Mutex::new(false);

fn told(what: &str) -> bool {
    std::env::var("OIDN_STUB").is_ok_and(|told| told == what)
}

/// Any pointer that is not null.
#[unsafe(no_mangle)]
extern "C" fn oidnNewDevice(_: c_int) -> *mut c_void {
    std::ptr::from_ref(&IMAGES).cast_mut().cast()
}

#[cfg(not(version_1))]
mod since_version_2 {
    use super::*;

    #[unsafe(no_mangle)]
    extern "C" fn oidnSetDeviceInt(_: *mut c_void, _: *const c_char, _: c_int) {}

    #[unsafe(no_mangle)]
    extern "C" fn oidnSetDeviceBool(_: *mut c_void, _: *const c_char, _: bool) {}

    #[unsafe(no_mangle)]
    extern "C" fn oidnGetDeviceInt(_: *mut c_void, _: *const c_char) -> c_int {
        if told("version-3") { 3 } else { 2 }
    }

    #[unsafe(no_mangle)]
    extern "C" fn oidnSetFilterBool(_: *mut c_void, _: *const c_char, _: bool) {}

    #[unsafe(no_mangle)]
    extern "C" fn oidnSetFilterFloat(_: *mut c_void, _: *const c_char, _: f32) {}
}

#[unsafe(no_mangle)]
extern "C" fn oidnCommitDevice(_: *mut c_void) {}

#[unsafe(no_mangle)]
unsafe extern "C" fn oidnGetDeviceError(_: *mut c_void, text: *mut *const c_char) -> c_int {
    let (code, says) = match *EXECUTED.lock().unwrap() {
        true if told("no-memory") => (4, c"out of memory"),
        true if told("fault") => (1, c"the stub was told to fail"),
        _ => (0, c""),
    };
    unsafe { *text = says.as_ptr() };
    code
}

#[unsafe(no_mangle)]
extern "C" fn oidnReleaseDevice(_: *mut c_void) {}

#[unsafe(no_mangle)]
extern "C" fn oidnNewFilter(device: *mut c_void, _: *const c_char) -> *mut c_void {
    device
}

#[unsafe(no_mangle)]
unsafe extern "C" fn oidnSetSharedFilterImage(
    _: *mut c_void,
    name: *const c_char,
    image: *mut c_void,
    _: c_int,
    width: usize,
    height: usize,
    _: usize,
    _: usize,
    _: usize,
) {
    let is_output = unsafe { CStr::from_ptr(name) } == c"output";
    let mut images = IMAGES.lock().unwrap();
    images[usize::from(is_output)] = image as usize;
    images[2] = 3 * width * height;
}

#[unsafe(no_mangle)]
extern "C" fn oidnCommitFilter(_: *mut c_void) {}

#[unsafe(no_mangle)]
unsafe extern "C" fn oidnExecuteFilter(_: *mut c_void) {
    let [from, to, count] = *IMAGES.lock().unwrap();
    unsafe { std::ptr::copy_nonoverlapping(from as *const f32, to as *mut f32, count) };
    *EXECUTED.lock().unwrap() = true;
}

#[unsafe(no_mangle)]
extern "C" fn oidnReleaseFilter(_: *mut c_void) {}
