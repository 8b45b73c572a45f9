//! Intel's Open Image Denoise over lightmaps, as a library that is found when the program runs.
//!
//! The filter `RTLightmap` of its version 2 is a trained network: it knows what rendered light looks like, sees neither
//! positions nor normals, and looks farther than [`crate::denoise`]. What it returns has no error of its own, so that is
//! estimated here. Two halves of the rays are filtered apart. Half of what their results differ by is the noise of
//! their mean (as in Rousselle et al. 2012, "Adaptive Rendering with Non-Local Means Filtering"). Bias is what both have in
//! common: where the filter is right, what it took away is noise, and the mean of that over a window is as small as the
//! noise of the mean, which the halves tell as well. What exceeds it is bias: in a texel alone, where edges are, and in
//! windows of two sizes.
//!
//! Then filtered and measured light are averaged, each weighed by the other's squared error. Where the network errs, as it
//! does by a percent on light without noise and at hard shadows, what was measured stands.
//! The same average of the squared errors is the error of the result, however both depend on each other (Jensen's inequality).
//!
//! Measured by `tests/honesty.rs` on direct and indirect light of four kinds, each with eight seeds that the constants below
//! were not chosen on: 0 to 0.6 % of errors lie beyond three of the sigmas, which are 1.1 to 2.2 times the root of the mean
//! squared error.
//!
//! The same library gives the same bytes for any number of threads; other versions of it give others.

use std::ffi::c_char;
use std::path::PathBuf;
use std::sync::OnceLock;

use crate::denoise::Denoised;

/// Names the library where it does not lie where the system looks.
pub const VARIABLE: &str = "LIGHTKILN_OIDN";

/// Colors of a texel.
const RGB: usize = 3;

/// Half widths of the windows that look for bias, in texels, and by which factor the square of a mean must exceed its
/// variance there: four sigmas in a texel alone, of which there are many, two in windows of 3 and 9.
const WINDOWS: [(usize, f64); 3] = [(0, 16.0), (1, 4.0), (4, 4.0)];
/// Variances of single texels are means over windows of this half width at least.
const LEAST_WINDOW: usize = 1;
/// Bias spreads to so many texels around.
const SPREAD: usize = 1;
/// Half width of the window that noise is averaged over.
const AROUND: usize = 3;
/// The noise of the filtered is taken to be so much larger than what halves show.
const CAREFUL: f64 = 2.0;
/// Bias that no window tells from noise, as a share of the variance of what was measured.
const UNSEEN: f64 = 1.0 / 25.0;

/// What keeps light from being filtered by the library.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum OidnError {
    /// It is not there, or is no such library.
    #[error("Open Image Denoise 2 cannot be loaded: {why}")]
    Missing {
        /// What the system says.
        why: String,
    },
    /// It is there in a version that is called otherwise.
    #[error("Open Image Denoise is there in version {found}; version 2 is needed")]
    Version {
        /// Of the library.
        found: String,
    },
    /// There is no memory for an image of this size.
    #[error("no memory for an image of {} x {} texels in Open Image Denoise", .size[0], .size[1])]
    NoMemory {
        /// Width and height in texels.
        size: [u32; 2],
    },
    /// It refused its work.
    #[error("Open Image Denoise failed: {why}")]
    Failed {
        /// What it says.
        why: String,
    },
}

/// An image of light.
#[derive(Clone, Copy, Debug)]
pub struct Lightmap<'a> {
    /// Width and height in texels.
    pub size: [u32; 2],
    /// Two independent measurements, texels x RGB each, row-major, all of them finite: what is not measured holds what
    /// continues the light around it.
    pub halves: [&'a [f32]; 2],
    /// Both together; only those of measured texels count.
    pub values: &'a [f32],
    /// Variance of each value; only those of measured texels count.
    pub variances: &'a [f32],
    /// Which texels are measured.
    pub measured: &'a [bool],
    /// Values of about -1 to 1 that are no light but say where it comes from: harmonics as shares of the first.
    pub directional: bool,
}

/// Finds the library, once for the whole program.
///
/// # Errors
/// [`OidnError::Missing`].
pub fn find() -> Result<(), OidnError> {
    library().map(|_| ())
}

/// An image of zeros, texels x RGB.
///
/// # Errors
/// [`OidnError::NoMemory`].
pub fn image(size: [u32; 2]) -> Result<Vec<f32>, OidnError> {
    let mut image = Vec::new();
    let length = size[0] as usize * size[1] as usize * RGB;
    image.try_reserve_exact(length).map_err(|_| OidnError::NoMemory { size })?;
    image.resize(length, 0.0);
    Ok(image)
}

/// Filters; texels that are not measured get values too, and variances where a measured one is within three texels.
///
/// # Errors
/// [`OidnError`].
///
/// # Panics
/// Where the lengths of the slices do not fit the size: a mistake of the caller.
pub fn denoise(map: Lightmap<'_>) -> Result<Denoised, OidnError> {
    let texels = map.size[0] as usize * map.size[1] as usize;
    assert!(map.halves.iter().all(|half| half.len() == texels * RGB), "three values a texel");
    assert!(map.values.len() == texels * RGB, "three values a texel");
    assert!(map.variances.len() == texels * RGB, "three variances a texel");
    assert!(map.measured.len() == texels, "every texel is measured or not");
    if texels == 0 {
        return Ok(Denoised { values: Vec::new(), variances: Vec::new() });
    }
    let library = library()?;
    let [a, b] = map.halves.map(|half| library.lightmap(half, map.size, map.directional));
    Ok(judged(map, [&a?, &b?]))
}

/// The mean of the filtered halves, as far as it can be trusted, and the expected square of each value's error: bias and
/// noise. Infinite where nothing is measured.
fn judged(map: Lightmap<'_>, filtered: [&[f32]; 2]) -> Denoised {
    let texels = map.measured.len();
    let mean = |[a, b]: [&[f32]; 2], at: usize| 0.5 * (f64::from(a[at]) + f64::from(b[at]));
    // The variance of the mean of two, from two alone.
    let spread = |[a, b]: [&[f32]; 2], at: usize| 0.25 * (f64::from(a[at]) - f64::from(b[at])).powi(2);
    let mut denoised =
        Denoised { values: vec![0.0; texels * RGB], variances: vec![f32::INFINITY; texels * RGB] };
    let counts = Sums::new(map.size, |texel| f64::from(u8::from(map.measured[texel])));
    for color in 0..RGB {
        let of_measured = |value: &dyn Fn(usize) -> f64| {
            Sums::new(map.size, |texel| if map.measured[texel] { value(texel * RGB + color) } else { 0.0 })
        };
        let variances = of_measured(&|at| f64::from(map.variances[at]));
        let noise = of_measured(&|at| spread(map.halves, at));
        let noise_left = of_measured(&|at| spread(filtered, at));
        let changes = of_measured(&|at| mean(filtered, at) - f64::from(map.values[at]));
        let over = |sums: &Sums, texel: usize, window: usize| {
            sums.around(texel, window) / counts.around(texel, window).max(1.0)
        };
        let bias = |texel: usize| {
            let beyond = WINDOWS.map(|(window, factor)| {
                let variance = over(&noise, texel, window.max(LEAST_WINDOW));
                let change = over(&changes, texel, window);
                change * change - factor * variance / counts.around(texel, window).max(1.0)
            });
            beyond.into_iter().fold(0.0, f64::max)
        };
        let bias: Vec<f64> = (0..texels).map(bias).collect();
        let of_bias = of_measured(&|at| bias[at / RGB]);
        for (texel, &own_bias) in bias.iter().enumerate() {
            let at = texel * RGB + color;
            denoised.values[at] = mean(filtered, at) as f32;
            if counts.around(texel, AROUND) == 0.0 {
                continue;
            }
            let noise = CAREFUL * over(&noise_left, texel, AROUND) + UNSEEN * over(&variances, texel, AROUND);
            let error = noise + own_bias.max(over(&of_bias, texel, SPREAD));
            denoised.variances[at] = error as f32;
            if map.measured[texel] {
                let own = f64::from(map.variances[at]);
                let share = if error > 0.0 { error / (error + own) } else { 0.0 };
                let value = mean(filtered, at) * (1.0 - share) + f64::from(map.values[at]) * share;
                denoised.values[at] = value as f32;
                denoised.variances[at] = (error * (1.0 - share) + own * share) as f32;
            }
        }
    }
    denoised
}

/// Sums over windows of an image, from sums over all that is above and to the left (Crow 1984, "Summed-Area Tables for
/// Texture Mapping").
struct Sums {
    size: [usize; 2],
    /// (width + 1) x (height + 1).
    table: Vec<f64>,
}

impl Sums {
    fn new(size: [u32; 2], value: impl Fn(usize) -> f64) -> Self {
        let [width, height] = size.map(|s| s as usize);
        let mut table = vec![0.0; (width + 1) * (height + 1)];
        for y in 0..height {
            let mut row = 0.0;
            for x in 0..width {
                row += value(y * width + x);
                table[(y + 1) * (width + 1) + x + 1] = table[y * (width + 1) + x + 1] + row;
            }
        }
        Self { size: [width, height], table }
    }

    /// Over the texels up to `window` away in each direction, that of the texel itself with them.
    fn around(&self, texel: usize, window: usize) -> f64 {
        let [width, height] = self.size;
        let (x, y) = (texel % width, texel / width);
        let (left, right) = (x.saturating_sub(window), (x + window + 1).min(width));
        let (top, bottom) = (y.saturating_sub(window), (y + window + 1).min(height));
        let at = |x: usize, y: usize| self.table[y * (width + 1) + x];
        at(right, bottom) - at(left, bottom) - at(right, top) + at(left, top)
    }
}

fn library() -> Result<&'static Library, OidnError> {
    // Its threads may outlive a filter, so it is never unloaded.
    static LIBRARY: OnceLock<Result<Library, OidnError>> = OnceLock::new();
    LIBRARY.get_or_init(Library::open).as_ref().map_err(Clone::clone)
}

use calls::Library;

impl Library {
    /// Where it may lie, in the order in which it is looked for.
    fn names() -> Vec<PathBuf> {
        if let Some(path) = std::env::var_os(VARIABLE).filter(|path| !path.is_empty()) {
            return vec![path.into()];
        }
        let names: &[&str] = if cfg!(windows) {
            &["OpenImageDenoise.dll"]
        } else if cfg!(target_os = "macos") {
            &["libOpenImageDenoise.2.dylib", "libOpenImageDenoise.dylib"]
        } else {
            &["libOpenImageDenoise.so.2", "libOpenImageDenoise.so"]
        };
        names.iter().map(PathBuf::from).collect()
    }
}

/// All that is unsafe: calls of a C library.
///
/// What makes them sound: the signatures are those of `oidn.h`, version 2, which keeps them for the whole of it, and a
/// library that says that it is another, or lacks one of them as version 1 does, is refused. Handles are made, used and released within one call of
/// [`Library::lightmap`], by one thread. The library reads `color` and writes `output` only while it executes a filter,
/// and both are slices of the size that it is told, alive beyond the filter's release. Texts that it returns
/// are copied before the next call.
#[allow(unsafe_code)] // a C library can be called in no other way; the page above says what makes it sound
mod calls {
    use std::ffi::{CStr, c_int, c_void};
    use std::ptr::{null, null_mut};

    use super::{OidnError, RGB, c_char, image};

    type Device = *mut c_void;
    type Filter = *mut c_void;
    type Name = *const c_char;

    const DEVICE_CPU: c_int = 1;
    const FLOAT3: c_int = 3;
    const OUT_OF_MEMORY: c_int = 4;
    /// The version whose functions these are.
    const VERSION: c_int = 2;

    /// Half of the largest harmonic of a band up to 2 as a share of the first is below 1.
    const DIRECTIONAL_SCALE: f32 = 0.5;

    /// The functions of the library that are used.
    pub struct Library {
        new_device: unsafe extern "C" fn(c_int) -> Device,
        set_device_int: unsafe extern "C" fn(Device, Name, c_int),
        set_device_bool: unsafe extern "C" fn(Device, Name, bool),
        device_int: unsafe extern "C" fn(Device, Name) -> c_int,
        commit_device: unsafe extern "C" fn(Device),
        device_error: unsafe extern "C" fn(Device, *mut Name) -> c_int,
        release_device: unsafe extern "C" fn(Device),
        new_filter: unsafe extern "C" fn(Device, Name) -> Filter,
        set_image: unsafe extern "C" fn(Filter, Name, *mut c_void, c_int, usize, usize, usize, usize, usize),
        set_bool: unsafe extern "C" fn(Filter, Name, bool),
        set_float: unsafe extern "C" fn(Filter, Name, f32),
        commit_filter: unsafe extern "C" fn(Filter),
        execute: unsafe extern "C" fn(Filter),
        release_filter: unsafe extern "C" fn(Filter),
    }

    impl Library {
        /// Loads it, and keeps it for as long as the program runs.
        pub fn open() -> Result<Self, OidnError> {
            let mut whys = Vec::new();
            for name in Self::names() {
                // SAFETY: what runs when it is loaded is its own initialization; that the file is what its name says is
                // the promise of whoever put it there.
                match unsafe { libloading::Library::new(&name) } {
                    Ok(found) => return Self::checked(found, &name.to_string_lossy()),
                    Err(error) => whys.push(said(&error)),
                }
            }
            Err(OidnError::Missing { why: whys.join("; ") })
        }

        /// Tells other libraries and other versions by their functions, and by what they say.
        fn checked(found: libloading::Library, name: &str) -> Result<Self, OidnError> {
            // SAFETY: nothing is called.
            let has = |symbol: &[u8]| unsafe { found.get::<*const c_void>(symbol) }.is_ok();
            if !has(b"oidnNewDevice\0") {
                return Err(OidnError::Missing { why: format!("{name} is another library") });
            }
            if !has(b"oidnGetDeviceInt\0") {
                return Err(OidnError::Version { found: "1".to_owned() });
            }
            let library = Self::functions(found).map_err(|e| OidnError::Missing { why: said(&e) })?;
            // SAFETY: see the module.
            let version = unsafe {
                let device = (library.new_device)(DEVICE_CPU);
                if device.is_null() {
                    return Err(library.error(null_mut(), [0; 2]).unwrap_or_else(|| failed("no device")));
                }
                let version = (library.device_int)(device, c"versionMajor".as_ptr());
                (library.release_device)(device);
                version
            };
            if version == VERSION {
                Ok(library)
            } else {
                Err(OidnError::Version { found: version.to_string() })
            }
        }

        fn functions(library: libloading::Library) -> Result<Self, libloading::Error> {
            // Never unloaded, so that the functions stay where they are.
            let library = std::mem::ManuallyDrop::new(library);
            // SAFETY: these are the signatures of version 2, as said above.
            unsafe {
                Ok(Self {
                    new_device: *library.get(b"oidnNewDevice\0")?,
                    set_device_int: *library.get(b"oidnSetDeviceInt\0")?,
                    set_device_bool: *library.get(b"oidnSetDeviceBool\0")?,
                    device_int: *library.get(b"oidnGetDeviceInt\0")?,
                    commit_device: *library.get(b"oidnCommitDevice\0")?,
                    device_error: *library.get(b"oidnGetDeviceError\0")?,
                    release_device: *library.get(b"oidnReleaseDevice\0")?,
                    new_filter: *library.get(b"oidnNewFilter\0")?,
                    set_image: *library.get(b"oidnSetSharedFilterImage\0")?,
                    set_bool: *library.get(b"oidnSetFilterBool\0")?,
                    set_float: *library.get(b"oidnSetFilterFloat\0")?,
                    commit_filter: *library.get(b"oidnCommitFilter\0")?,
                    execute: *library.get(b"oidnExecuteFilter\0")?,
                    release_filter: *library.get(b"oidnReleaseFilter\0")?,
                })
            }
        }

        /// Filters an image, texels x RGB.
        pub fn lightmap(
            &self,
            color: &[f32],
            size: [u32; 2],
            directional: bool,
        ) -> Result<Vec<f32>, OidnError> {
            let [width, height] = size.map(|s| s as usize);
            assert!(color.len() == width * height * RGB, "three values a texel");
            let mut output = image(size)?;
            let threads = rayon::current_num_threads() as c_int;
            // SAFETY: see the module. The library does not write to `color`, whatever its signature says.
            unsafe {
                let device = (self.new_device)(DEVICE_CPU);
                if device.is_null() {
                    return Err(self.error(null_mut(), size).unwrap_or_else(|| failed("no device")));
                }
                (self.set_device_int)(device, c"numThreads".as_ptr(), threads);
                (self.set_device_bool)(device, c"setAffinity".as_ptr(), false);
                (self.commit_device)(device);
                let mut error = self.error(device, size);
                if error.is_none() {
                    let filter = (self.new_filter)(device, c"RTLightmap".as_ptr());
                    let set = |name: Name, image: *mut f32| {
                        (self.set_image)(filter, name, image.cast(), FLOAT3, width, height, 0, 0, 0);
                    };
                    set(c"color".as_ptr(), color.as_ptr().cast_mut());
                    set(c"output".as_ptr(), output.as_mut_ptr());
                    if directional {
                        (self.set_bool)(filter, c"directional".as_ptr(), true);
                        (self.set_float)(filter, c"inputScale".as_ptr(), DIRECTIONAL_SCALE);
                    }
                    (self.commit_filter)(filter);
                    error = self.error(device, size);
                    if error.is_none() {
                        (self.execute)(filter);
                        error = self.error(device, size);
                    }
                    (self.release_filter)(filter);
                }
                (self.release_device)(device);
                match error {
                    Some(error) => Err(error),
                    None => Ok(output),
                }
            }
        }

        /// The first error since the last call; null asks for that of a device that could not be made.
        fn error(&self, device: Device, size: [u32; 2]) -> Option<OidnError> {
            let mut text: Name = null();
            // SAFETY: see the module.
            let (code, text) = unsafe {
                let code = (self.device_error)(device, &mut text);
                (code, (!text.is_null()).then(|| CStr::from_ptr(text).to_string_lossy().into_owned()))
            };
            match code {
                0 => None,
                OUT_OF_MEMORY => Some(OidnError::NoMemory { size }),
                _ => Some(failed(&text.unwrap_or_else(|| code.to_string()))),
            }
        }
    }

    fn failed(why: &str) -> OidnError {
        OidnError::Failed { why: why.to_owned() }
    }

    /// What the system says, with its reason where it has one.
    fn said(error: &libloading::Error) -> String {
        match std::error::Error::source(error) {
            Some(source) if !error.to_string().contains(&source.to_string()) => format!("{error}: {source}"),
            _ => error.to_string(),
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::print_stdout)] // what was skipped, and what was measured

    use lightkiln_mesh::random;

    use super::*;

    const SIZE: [u32; 2] = [96, 80];

    /// Light without noise: a slope, a wave, a hard edge, a peak.
    fn light(kind: usize, x: f32, y: f32) -> f32 {
        let from = |a: f32, b: f32| (x - a).powi(2) + (y - b).powi(2);
        0.02 + match kind {
            0 => 1.0 + 2.0 * x,
            1 => 1.0 + (9.0 * x).sin() * (7.0 * y).cos(),
            2 => 3.0 * f32::from(u8::from(from(0.5, 0.5) > 0.08)) + 0.1,
            _ => 1.0 / (0.02 + from(0.3, 0.4)),
        }
    }

    /// Light, texels x RGB, and measurements of it with noise that is a share of it.
    struct Image {
        truth: Vec<f32>,
        halves: [Vec<f32>; 2],
        values: Vec<f32>,
        variances: Vec<f32>,
        measured: Vec<bool>,
    }

    impl Image {
        fn new(kind: usize, spread: f32) -> Self {
            let texels = SIZE[0] * SIZE[1];
            let mut image = Self {
                truth: Vec::new(),
                halves: [Vec::new(), Vec::new()],
                values: Vec::new(),
                variances: Vec::new(),
                measured: vec![true; texels as usize],
            };
            for texel in 0..texels {
                let (x, y) = (texel % SIZE[0], texel / SIZE[0]);
                let own = light(kind, x as f32 / SIZE[0] as f32, y as f32 / SIZE[1] as f32);
                for color in [1.0, 0.8, 0.5] {
                    // The mean of some exponential numbers: never negative, as light is.
                    let count = (0.5 / (spread * spread)).round() as u64;
                    let key = random::hash(7, u64::from(texel), (color * 10.0) as u64, kind as u64);
                    let halves = [0, 1].map(|half| {
                        let one = |k| -(1.0 - random::unit(random::hash(key, k, half, 0))).ln();
                        own * color * (0..count).map(one).sum::<f32>() / count as f32
                    });
                    image.truth.push(own * color);
                    image.halves.iter_mut().zip(halves).for_each(|(half, value)| half.push(value));
                    image.values.push(0.5 * (halves[0] + halves[1]));
                    image.variances.push((own * color).powi(2) / (2 * count) as f32);
                }
            }
            image
        }

        fn map(&self) -> Lightmap<'_> {
            Lightmap {
                size: SIZE,
                halves: [&self.halves[0], &self.halves[1]],
                values: &self.values,
                variances: &self.variances,
                measured: &self.measured,
                directional: false,
            }
        }
    }

    /// Says loudly where there is no library to test.
    fn is_here() -> bool {
        let found = find();
        if let Err(error) = &found {
            println!("!! SKIPPED: {error}; {VARIABLE} names it");
        }
        found.is_ok()
    }

    #[test]
    fn oidn_errors_are_as_small_as_it_says_and_noise_is_gone() {
        if !is_here() {
            return;
        }
        for kind in 0..4 {
            for spread in [0.1, 0.2, 0.5] {
                let image = Image::new(kind, spread);
                let filtered = denoise(image.map()).unwrap();
                let truth = &image.truth;
                let mean_square = |values: &[f32]| -> f64 {
                    let errors = values.iter().zip(truth).map(|(v, t)| f64::from((v - t) / t).powi(2));
                    errors.sum::<f64>() / truth.len() as f64
                };
                let rows = filtered.values.iter().zip(&filtered.variances).zip(truth);
                let beyond = rows.filter(|((v, e), t)| (*v - *t).abs() > 3.0 * e.sqrt()).count();
                let share = beyond as f64 / truth.len() as f64;
                let left = (mean_square(&filtered.values) / mean_square(&image.values)).sqrt();
                println!("light {kind}, noise {spread}: {share:.4} beyond three sigma, {left:.2} of it left");
                assert!(share < 0.01, "light {kind}, noise {spread}: {share}");
                assert!(left < 0.5, "light {kind}, noise {spread}: {left} is left");
            }
        }
    }

    #[test]
    fn oidn_gives_the_same_bytes_for_any_number_of_threads_and_keeps_signs() {
        if !is_here() {
            return;
        }
        for directional in [false, true] {
            let mut image = Image::new(1, 0.3);
            if directional {
                let sign = |values: &mut Vec<f32>| values.iter_mut().for_each(|v| *v = 0.3 * (*v - 0.8));
                image.halves.iter_mut().for_each(sign);
                sign(&mut image.values);
            }
            let map = Lightmap { directional, ..image.map() };
            let run = |threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| denoise(map).unwrap())
            };
            let one = run(1);
            assert_eq!(one, run(2));
            assert_eq!(one.values.iter().any(|v| *v < -0.1), directional);
        }
    }

    #[test]
    fn sums_over_windows_end_at_the_border() {
        let sums = Sums::new([4, 3], |texel| texel as f64);
        assert_eq!(sums.around(5, 0), 5.0);
        assert_eq!(sums.around(0, 1), (1 + 4 + 5) as f64);
        assert_eq!(sums.around(6, 9), 66.0);
    }

    #[test]
    fn judged_sees_what_a_filter_took_away() {
        let size = [24, 24];
        let texels = 24 * 24;
        let edge: Vec<f32> = (0..texels * RGB).map(|i| f32::from(u8::from(i / RGB % 24 >= 12))).collect();
        let flat = vec![0.5; texels * RGB];
        let measured: Vec<bool> = (0..texels).map(|texel| texel / 24 < 12).collect();
        let variances = vec![1e-4; texels * RGB];
        let map = Lightmap {
            size,
            halves: [&edge, &edge],
            values: &edge,
            variances: &variances,
            measured: &measured,
            directional: false,
        };
        // Nothing was changed: what no window sees is left.
        let kept = judged(map, [&edge, &edge]);
        assert_eq!(kept.values, edge);
        assert!(kept.variances[0] > 0.0 && kept.variances[0] < 0.1 * 1e-4, "{}", kept.variances[0]);
        // All of the edge was lost: what was measured stands, with its own variance or less than twice of it.
        let lost = judged(map, [&flat, &flat]);
        let of_measured = 0..12 * 24 * RGB;
        assert!(of_measured.clone().all(|i| (lost.values[i] - edge[i]).abs() < 1e-3));
        assert!(of_measured.clone().all(|i| (1e-4..2e-4).contains(&lost.variances[i])));
        // Where nothing is measured nothing else stands.
        assert!(lost.values[13 * 24 * RGB] == 0.5 && lost.variances[(13 * 24 + 3) * RGB] > 0.2);
        assert!(lost.variances[(20 * 24 + 3) * RGB].is_infinite());
        // Halves that differ by noise say how much.
        let [up, down] = [0.02, -0.02].map(|by| edge.iter().map(|v| v + by).collect::<Vec<_>>());
        let noisy = judged(Lightmap { halves: [&up, &down], ..map }, [&up, &down]);
        assert!(noisy.variances[0] > 0.5 * 1e-4, "{}", noisy.variances[0]);
    }

    #[test]
    fn image_beyond_all_memory_is_refused() {
        let size = [u32::MAX, u32::MAX];
        assert_eq!(image(size), Err(OidnError::NoMemory { size }));
    }
}
