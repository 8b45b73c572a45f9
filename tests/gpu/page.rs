//! Prints a web page that draws the cases with the GLSL of `shaders/` and says how far each program is off.
//!
//!     cargo run --release -p lightkiln-gpu --example gpu_page > check.html
//!
//! Opened in a browser it shows, for each program and curve, the largest difference in stored units: about 1e-6 where
//! the browser filters with full precision. A GPU whose filter has weights of 8 bits comes to 0.004, for neighbouring
//! texels are random here. `web.test.mjs` opens it in a headless browser.

#![allow(clippy::print_stdout)] // a page is what it is for

use lightkiln_gpu::{BOUND, PAGES, PIXELS, SIZE};

macro_rules! shaders {
    ($($file:literal),*) => {
        [$(($file, include_str!(concat!("../../shaders/", $file)))),*]
    };
}

const SHADERS: [(&str, &str); 11] = shaders![
    "lightkiln.vert.glsl",
    "lightkiln.frag.glsl",
    "programs/scalar.vert.glsl",
    "programs/scalar.frag.glsl",
    "programs/clamped.frag.glsl",
    "programs/rgb.vert.glsl",
    "programs/rgb.frag.glsl",
    "programs/table.vert.glsl",
    "programs/interop.vert.glsl",
    "programs/sh.vert.glsl",
    "programs/sh.frag.glsl"
];

fn main() -> Result<(), serde_json::Error> {
    let (textures, cases) = lightkiln_gpu::cases();
    let shaders: serde_json::Map<_, _> =
        SHADERS.into_iter().map(|(file, source)| (file.to_owned(), source.into())).collect();
    println!("<!doctype html><meta charset=\"utf-8\"><title>The shaders on this GPU</title>");
    println!("<link rel=\"icon\" href=\"data:,\"><pre id=\"result\"></pre><script type=\"module\">");
    println!("const size = {SIZE:?}, pages = {PAGES}, pixels = {PIXELS}, bound = {BOUND}");
    println!("const shaders = {}", serde_json::to_string(&shaders)?);
    println!("const textures = {}", serde_json::to_string(&textures)?);
    println!("const cases = {}", serde_json::to_string(&cases)?);
    println!("{}</script>", include_str!("page.js"));
    Ok(())
}
