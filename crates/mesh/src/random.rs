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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hash_of_neighbouring_keys_is_uniform_and_uncorrelated() {
        let count = 100_000_u64;
        let (mut mean, mut product) = (0.0_f64, 0.0_f64);
        for i in 0..count {
            let (x, y) = (unit(hash(7, 1, 2, i)), unit(hash(7, 1, 2, i + 1)));
            mean += f64::from(x) / count as f64;
            product += f64::from(x - 0.5) * f64::from(y - 0.5) / count as f64;
        }
        assert!((mean - 0.5).abs() < 0.005, "{mean}");
        assert!(product.abs() < 0.002, "{product}");
    }

    #[test]
    fn hash_depends_on_every_word() {
        let base = hash(1, 2, 3, 4);
        for other in
            [hash(0, 2, 3, 4), hash(1, 0, 3, 4), hash(1, 2, 0, 4), hash(1, 2, 3, 0), hash(1, 3, 2, 4)]
        {
            assert_ne!(base, other);
        }
    }

    #[test]
    fn square_to_triangle_stays_inside() {
        for i in 0..1000 {
            let [u, v] = square_to_triangle(unit2(finalize(i)));
            assert!(u >= 0.0 && v >= 0.0 && u + v <= 1.0);
        }
    }
}
