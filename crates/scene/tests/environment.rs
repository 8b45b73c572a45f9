//! Environment maps: every format, and everything that can be wrong with one.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // helpers of tests are tests

mod common;

use std::io::Cursor;

use common::Folder;
use image::{DynamicImage, ImageFormat};
use lightkiln_scene::{SceneError, decode_environment, read_environment};

/// An image of 4 x 2 pixels whose green tells them apart.
fn pixels() -> image::Rgb32FImage {
    image::Rgb32FImage::from_fn(4, 2, |x, y| image::Rgb([0.5, (y * 4 + x) as f32, 1000.0]))
}

fn encoded(image: impl Into<DynamicImage>, format: ImageFormat) -> Vec<u8> {
    let mut out = Cursor::new(Vec::new());
    image.into().write_to(&mut out, format).unwrap();
    out.into_inner()
}

#[test]
fn environment_exr_is_read_exactly() {
    for image in [DynamicImage::from(pixels()), DynamicImage::from(pixels()).into_rgba32f().into()] {
        let map = decode_environment(&encoded(image, ImageFormat::OpenExr)).unwrap();
        assert_eq!((map.width, map.height), (4, 2));
        assert!(map.warnings.is_empty());
        let expected: Vec<[f32; 3]> = pixels().pixels().map(|p| p.0).collect();
        assert_eq!(map.pixels, expected);
    }
}

/// A Radiance file without run lengths, with header lines of its own.
fn radiance(header: &str, rgbe: &[[u8; 4]]) -> Vec<u8> {
    let mut out = format!("#?RADIANCE\n{header}FORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n").into_bytes();
    rgbe.iter().for_each(|p| out.extend(p));
    out
}

#[test]
fn environment_radiance_is_divided_by_its_exposure() {
    // 128 with exponent 129 is 1.
    let texels: Vec<[u8; 4]> = (0..8).map(|i| [128, 64, 32, 129 + i]).collect();
    for (header, factor) in [("", 1.0), ("EXPOSURE=2.0\n", 0.5), ("EXPOSURE=2\nEXPOSURE=4\n", 0.125)] {
        let map = decode_environment(&radiance(header, &texels)).unwrap();
        assert_eq!((map.width, map.height), (4, 2));
        for (i, pixel) in map.pixels.iter().enumerate() {
            let one = factor * (1 << i) as f32;
            let error = pixel.iter().zip([one, one / 2.0, one / 4.0]).map(|(a, b)| (a / b - 1.0).abs());
            assert!(error.fold(0.0, f32::max) < 0.01, "{header} {i} {pixel:?}");
        }
    }
    for header in ["EXPOSURE=0\n", "EXPOSURE=-1\n"] {
        assert!(matches!(
            decode_environment(&radiance(header, &texels)),
            Err(SceneError::Environment { .. })
        ));
    }
    assert!(decode_environment(&radiance("", &texels[..5])).is_err());
}

#[test]
fn environment_of_8_bits_is_linear_with_a_warning() {
    for format in [ImageFormat::Png, ImageFormat::Jpeg, ImageFormat::WebP] {
        let image = image::RgbImage::from_pixel(16, 8, image::Rgb([188; 3]));
        let map = decode_environment(&encoded(image, format)).unwrap();
        assert!(map.pixels.iter().all(|p| p.iter().all(|c| (c - 0.503).abs() < 0.01)), "{format:?}");
        assert_eq!(map.warnings.len(), 1);
    }
}

#[test]
fn environment_pixels_that_are_no_light_are_errors_with_their_place() {
    for bad in [f32::NAN, f32::INFINITY, -1.0] {
        let mut image = pixels();
        image.put_pixel(3, 1, image::Rgb([1.0, bad, 1.0]));
        let error = decode_environment(&encoded(image, ImageFormat::OpenExr)).unwrap_err();
        assert!(matches!(error, SceneError::EnvironmentPixel { x: 3, y: 1, .. }), "{error}");
    }
}

#[test]
fn environment_shape_and_blackness_are_warned_of() {
    let map = decode_environment(&encoded(image::Rgb32FImage::new(3, 3), ImageFormat::OpenExr)).unwrap();
    assert_eq!(map.warnings.len(), 2);
}

#[test]
fn environment_of_another_kind_is_an_error() {
    let lying = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 8192 +X 16384\n";
    let huge = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1000000 +X 1000000\n";
    let none = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 0 +X 4\n";
    let xyz = b"#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 2 +X 4\n";
    let cases: [&[u8]; 9] = [
        b"",
        b"glTF",
        b"#?",
        lying,
        none,
        xyz,
        b"version https://git-lfs.github.com/spec/v1",
        b"\x89PNG\r\n\x1a\n",
        b"v/1\x01",
    ];
    for bytes in cases {
        let error = decode_environment(bytes).unwrap_err();
        assert!(matches!(error, SceneError::Environment { .. }), "{error}");
        println!("{error}");
    }
    assert!(matches!(decode_environment(huge), Err(SceneError::TooLarge { .. })));
    let folder = Folder::new("environment");
    assert!(matches!(read_environment(&folder.0.join("none.hdr")), Err(SceneError::Io { .. })));
    assert!(matches!(read_environment(&folder.0), Err(SceneError::Io { .. })));
    let path = folder.0.join("text.hdr");
    std::fs::write(&path, "hello").unwrap();
    assert_eq!(read_environment(&path).unwrap_err().place().file.as_deref(), Some(&*path));
}

#[test]
fn environment_damage_never_panics() {
    let radiance = radiance("EXPOSURE=1\n", &[[128, 64, 32, 129]; 8]);
    let packed =
        encoded(image::Rgb32FImage::from_pixel(64, 32, image::Rgb([0.5, 1.0, 2.0])), ImageFormat::Hdr);
    let exr = encoded(pixels(), ImageFormat::OpenExr);
    let png = encoded(image::RgbImage::new(4, 2), ImageFormat::Png);
    let mut state = 1_u64;
    let mut below = |n: usize| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        ((state >> 33) as usize) % n
    };
    for round in 0..4000 {
        let mut bytes = [&radiance, &packed, &exr, &png][round % 4].clone();
        for _ in 0..=below(3) {
            let at = below(bytes.len());
            bytes[at] = below(256) as u8;
        }
        if below(4) == 0 {
            bytes.truncate(below(bytes.len()));
        }
        if let Ok(map) = decode_environment(&bytes) {
            assert_eq!(map.pixels.len(), map.width * map.height);
        }
    }
}
