// The numbers of the format. Their source is crates/encode/src/constants.rs; a test compares the two files.

/** The extension's name. */
export const EXTENSION = 'LIGHTKILN_lightmap'
/** The version of the format that is read here. */
export const VERSION = 2

/** Second integer of a code at or above this: a color-vertex. */
export const COLOR_FLAG = 32768
/** A scalar color is its value in 0..1 times this. */
export const COLOR_STEPS = 65535
/** Each channel of an RGB color is its value in 0..1 times this. */
export const RGB_STEPS = [1023, 2047, 1023]
/** Where each channel begins among the 31 bits of a color. */
export const RGB_SHIFTS = [21, 10, 0]
/** Bits of a color in the first integer. */
export const LOW_BITS = 16
/** Entries in a row of a table of colors. */
export const TABLE_WIDTH = 256
/** Texture-vertices count parts of a texel: this many to a texel. */
export const SUBTEXELS = 8
/** At and below this share of texture-vertices the atlas is not read. */
export const ETA_EPSILON = 1 / 65536
/** In the profile texcoord, a second number at or above this: a color-vertex. */
export const INTEROP_COLOR = 2
/** The logarithmic curve bends at white divided by this. */
export const CURVE_KNEE = 15
/** The base of the logarithmic curve. */
export const CURVE_BASE = 16

/** Factors of the real spherical harmonics of the layers `irradianceSh0` to `8`. */
export const SH_CONSTANT = 0.28209479177387814
export const SH_LINEAR = 0.4886025119029199
export const SH_PRODUCT = 1.0925484305920792
export const SH_AXIS = 0.31539156525252005
export const SH_DIFFERENCE = 0.5462742152960396
