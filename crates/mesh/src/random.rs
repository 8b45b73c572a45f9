//! Random numbers keyed by what they are for.
//!
//! A bake gives the same bytes for any number of threads, so no generator carries state from one sample to
//! the next: each number is a hash of its key (seed, triangle, sample, dimension).

/// Hashes four words into one: a chain of SplitMix64 finalizers (Steele, Lea and Flood 2014).
#[inline]
pub fn hash(seed: u64, a: u64, b: u64, c: u64) -> u64 {
    let mut h = seed;
    for word in [a, b, c] {
        h = finalize(h ^ word.wrapping_add(0x9e37_79b9_7f4a_7c15).wrapping_add(h << 6).wrapping_add(h >> 2));
    }
    h
}

/// SplitMix64's finalizer: a bijection of 64-bit words in which every input bit changes half the output bits.
#[inline]
pub fn finalize(mut z: u64) -> u64 {
    z = z.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A number in `0.0..1.0` from the top 24 bits of a hash.
#[inline]
pub fn unit(hash: u64) -> f32 {
    (hash >> 40) as f32 * (1.0 / 16_777_216.0)
}

/// Two numbers in `0.0..1.0` from one hash.
#[inline]
pub fn unit2(hash: u64) -> [f32; 2] {
    [unit(hash), unit(hash << 24)]
}

/// Maps the unit square to barycentric coordinates (weights of the second and third corner) with equal
/// areas, by folding the far half of the square back.
#[inline]
pub fn square_to_triangle([x, y]: [f32; 2]) -> [f32; 2] {
    if x + y > 1.0 { [1.0 - x, 1.0 - y] } else { [x, y] }
}
