//! What an RGB layer costs packed and from a table, on the vertices of real scenes (docs/CODES.md).
//!
//!     cargo run --release -p lightkiln-encode --example codes -- SCENE.glb...
//!
//! The light is irradiance in closed form, smooth and without noise: a sky, a sun and two colored lamps, none of them
//! shadowed, on the logarithmic scale of a bake. Vertices are those of the scene, welded by position and normal.
//! Prints a Markdown table: colors, and for each form the bytes beyond the 4 of the code, in the file (PNG) and on the
//! GPU (4 a color), and the largest and the root of the mean squared error in percent of the unit range.

#![allow(clippy::print_stdout)] // a table is what it is for

use std::error::Error;
use std::path::Path;

use glam::Vec3;
use lightkiln_encode::{LightCode, Table};
use lightkiln_light::Scale;
use lightkiln_scene::{ReadOptions, Scene};
use lightkiln_texel::{PngDepth, write_png};

/// How far colors that share an entry may be from it; the first is as fine as 8 bits are.
const BOUNDS: [f32; 3] = [0.0, 0.005, 0.015];

fn main() -> Result<(), Box<dyn Error>> {
    println!(
        "| scene | vertices | form | colors | file bytes | GPU bytes | bytes a vertex | largest % | rms % |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    for path in std::env::args().skip(1) {
        let path = Path::new(&path);
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        let vertices = vertices(&Scene::read(path, &ReadOptions::default())?);
        let values = unit_light(&vertices);

        let codes: Vec<LightCode> = values.iter().map(|&rgb| LightCode::color_rgb(rgb)).collect();
        let mut unique = codes.clone();
        unique.sort_unstable();
        unique.dedup();
        let shown = codes.iter().filter_map(|code| code.rgb());
        let (largest, rms) = errors(&values, shown);
        let count = vertices.len();
        println!("| {name} | {count} | packed | {} | 0 | 0 | 0 | {largest:.3} | {rms:.3} |", unique.len());

        for bound in BOUNDS {
            let (table, indices) = Table::build(values.as_flattened(), 3, bound)?;
            let (size, texels) = table.image();
            let mut png = Vec::new();
            let unit: Vec<f32> = texels.iter().map(|&value| f32::from(value) / 255.0).collect();
            write_png(&mut png, size, 3, PngDepth::Eight, &unit)?;
            let gpu = 4 * size[0] as usize * size[1] as usize;
            let (largest, rms) = errors(&values, indices.iter().map(|&index| table.color(index)));
            println!(
                "| | | table, {} | {} | {} | {gpu} | {:.2} | {largest:.3} | {rms:.3} |",
                if bound > 0.0 { format!("{} %", bound * 100.0) } else { "8 bits".to_owned() },
                table.len(),
                png.len(),
                png.len() as f64 / count as f64,
            );
        }
    }
    Ok(())
}

/// Position and normal of each light vertex.
fn vertices(scene: &Scene) -> Vec<[Vec3; 2]> {
    let mut all: Vec<[Vec3; 2]> = Vec::new();
    for part in &scene.parts {
        all.extend(part.positions.iter().zip(&part.normals).map(|(&position, &normal)| [position, normal]));
    }
    let bits = |[position, normal]: &[Vec3; 2]| {
        [position.to_array(), normal.to_array()].map(|v| v.map(f32::to_bits))
    };
    all.sort_unstable_by_key(bits);
    all.dedup_by_key(|vertex| bits(vertex));
    all
}

/// The light of each vertex, R, G and B in unit values of a scale whose white is four fifths of the brightest value.
fn unit_light(vertices: &[[Vec3; 2]]) -> Vec<[f32; 3]> {
    let (low, high) = vertices
        .iter()
        .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &[p, _]| (low.min(p), high.max(p)));
    let (centre, size) = ((low + high) / 2.0, (high - low).length().max(f32::MIN_POSITIVE));
    let sun = Vec3::new(0.5, 0.8, 0.3).normalize();
    let lamps = [
        (centre + Vec3::new(-0.6, 0.1, 0.2) * size, Vec3::new(900.0, 500.0, 200.0)),
        (centre + Vec3::new(0.3, 0.2, 0.7) * size, Vec3::new(150.0, 400.0, 700.0)),
    ];
    let light: Vec<Vec3> = vertices
        .iter()
        .map(|&[position, normal]| {
            let up = 0.5 + 0.5 * normal.y;
            let sky = Vec3::new(300.0, 420.0, 600.0) * up + Vec3::new(120.0, 100.0, 80.0) * (1.0 - up);
            let lamps = lamps.iter().map(|&(at, power)| {
                let way = (at - position) / size;
                power * normal.dot(way).max(0.0) / (way.length_squared() * way.length()).max(0.05)
            });
            sky + Vec3::new(2000.0, 1800.0, 1500.0) * normal.dot(sun).max(0.0) + lamps.sum::<Vec3>()
        })
        .collect();
    let brightest = light.iter().fold(0.0_f32, |most, rgb| most.max(rgb.max_element()));
    let scale = Scale::log(0.8 * brightest, 0.0, brightest);
    light.iter().map(|rgb| rgb.to_array().map(|x| scale.to_unit(x))).collect()
}

/// Largest and root mean square error over all channels, in percent.
fn errors(values: &[[f32; 3]], shown: impl Iterator<Item = [f32; 3]>) -> (f64, f64) {
    let (mut largest, mut squares) = (0.0_f64, 0.0);
    for (value, shown) in values.iter().zip(shown) {
        for (a, b) in value.iter().zip(shown) {
            let error = f64::from((a - b).abs());
            largest = largest.max(error);
            squares += error * error;
        }
    }
    (100.0 * largest, 100.0 * (squares / (3 * values.len().max(1)) as f64).sqrt())
}
