//! The numbers that the shaders and this crate must agree on. This is their one source: a test reads the
//! files in `shaders/` and compares.

/// Bit 15 of the second integer is set: a color-vertex. Clear: a texture-vertex.
pub const COLOR_FLAG: u16 = 0x8000;

/// The first integer of a color-vertex is its value in `0..=1` times this.
pub const COLOR_STEPS: u16 = 65535;

/// An RGB color-vertex has 31 bits beside the flag. They hold each channel in `0..=1` times this.
pub const RGB_STEPS: [u32; 3] = [1023, 2047, 1023];

/// Where each channel begins among those bits.
pub const RGB_SHIFTS: [u32; 3] = [21, 10, 0];

/// Bits of a color-vertex in its first integer; the others follow in the second.
pub const LOW_BITS: u32 = 16;

/// Entries in a row of the table of colors.
pub const TABLE_WIDTH: u32 = 256;

/// Most entries of a table: 32768 rows, and every index is exact as a float.
pub const TABLE_LIMIT: usize = 1 << 23;

/// The integers of a texture-vertex count parts of a texel: this many to a texel.
pub const SUBTEXELS: u32 = lightkiln_chart::SUBTEXELS;

/// Where the share of the texture-vertices is no larger than this, the atlas is not read.
///
/// `UV / eta` loses its digits as eta goes to 0 (and eta may come out of the interpolation a little below
/// it), but its weight is eta: leaving it out costs at most this much of the value, half a 15-bit step.
pub const ETA_EPSILON: f32 = 1.0 / 65536.0;

/// What the second coordinate of a color-vertex is in the interop form of section 4.4, a pair of floats.
pub const INTEROP_COLOR: f32 = 2.0;

/// The logarithmic curve bends at white divided by this.
pub const CURVE_KNEE: f32 = 15.0;

/// The base of the logarithmic curve: one more than its knee, so that white is 1.
pub const CURVE_BASE: f32 = 16.0;

/// Factors of the real spherical harmonics, orthonormal over the sphere: band 0.
pub const SH_CONSTANT: f64 = 0.28209479177387814;

/// Band 1: of y, z and x.
pub const SH_LINEAR: f64 = 0.4886025119029199;

/// Band 2: of xy, yz and xz.
pub const SH_PRODUCT: f64 = 1.0925484305920792;

/// Band 2: of 3z² - 1.
pub const SH_AXIS: f64 = 0.31539156525252005;

/// Band 2: of x² - y².
pub const SH_DIFFERENCE: f64 = 0.5462742152960396;

/// Name and numbers of each constant of the vertex stage, as the shaders spell it.
pub const VERTEX_CONSTANTS: [(&str, &[f64]); 8] = [
    ("LIGHTKILN_COLOR_FLAG", &[COLOR_FLAG as f64]),
    ("LIGHTKILN_COLOR_STEPS", &[COLOR_STEPS as f64]),
    ("LIGHTKILN_SUBTEXELS", &[SUBTEXELS as f64]),
    ("LIGHTKILN_INTEROP_COLOR", &[INTEROP_COLOR as f64]),
    ("LIGHTKILN_LOW_BITS", &[LOW_BITS as f64]),
    ("LIGHTKILN_RGB_SHIFTS", &[RGB_SHIFTS[0] as f64, RGB_SHIFTS[1] as f64, RGB_SHIFTS[2] as f64]),
    ("LIGHTKILN_RGB_STEPS", &[RGB_STEPS[0] as f64, RGB_STEPS[1] as f64, RGB_STEPS[2] as f64]),
    ("LIGHTKILN_TABLE_WIDTH", &[TABLE_WIDTH as f64]),
];

/// Name and numbers of each constant of the fragment stage.
pub const FRAGMENT_CONSTANTS: [(&str, &[f64]); 8] = [
    ("LIGHTKILN_ETA_EPSILON", &[ETA_EPSILON as f64]),
    ("LIGHTKILN_CURVE_KNEE", &[CURVE_KNEE as f64]),
    ("LIGHTKILN_CURVE_BASE", &[CURVE_BASE as f64]),
    ("LIGHTKILN_SH_CONSTANT", &[SH_CONSTANT]),
    ("LIGHTKILN_SH_LINEAR", &[SH_LINEAR]),
    ("LIGHTKILN_SH_PRODUCT", &[SH_PRODUCT]),
    ("LIGHTKILN_SH_AXIS", &[SH_AXIS]),
    ("LIGHTKILN_SH_DIFFERENCE", &[SH_DIFFERENCE]),
];
