// The eta-blend: C + eta * tex(UV / eta). Schaefer et al. 2012, section 4.3; CPU twin: crates/encode/src/decode.rs.
//
// `_LIGHTUV`: two unsigned 16-bit integers, vertex format uint16x2.
//   color-vertex     x = value * COLOR_STEPS   y >= COLOR_FLAG
//   texture-vertex   x = u * SUBTEXELS         y = v * SUBTEXELS, in texels; v runs through the stack of pages

const COLOR_FLAG: f32 = 32768.0;
const COLOR_STEPS: f32 = 65535.0;
const SUBTEXELS: f32 = 8.0;
const ETA_EPSILON: f32 = 0.0000152587890625;

@group(0) @binding(0) var<uniform> clip_from_object: mat4x4<f32>;
@group(0) @binding(1) var atlas: texture_2d_array<f32>; // one layer per page
@group(0) @binding(2) var atlas_sampler: sampler; // linear, clamp-to-edge

struct Varyings {
    @builtin(position) clip: vec4<f32>,
    @location(0) light: vec3<f32>, // UV in texels, and eta
    @location(1) color: f32, // C
}

@vertex
fn vertex_main(@location(0) position: vec3<f32>, @location(1) lightuv: vec2<u32>) -> Varyings {
    var out: Varyings;
    let code = vec2<f32>(lightuv);
    let is_color = code.y >= COLOR_FLAG;
    out.color = select(0.0, code.x / COLOR_STEPS, is_color);
    out.light = select(vec3<f32>(code / SUBTEXELS, 1.0), vec3<f32>(0.0), is_color);

    out.clip = clip_from_object * vec4<f32>(position, 1.0);
    return out;
}

// `by_x` and `by_y` are the derivatives of `at`. They must be taken where all pixels pass: inside the branch
// derivatives are undefined, and those of UV / eta follow from them by the quotient rule.
fn light(color: f32, at: vec3<f32>, by_x: vec3<f32>, by_y: vec3<f32>) -> f32 {
    var sum = color;
    let eta = at.z;
    if eta > ETA_EPSILON {
        let position = at.xy / eta;
        let size = vec2<f32>(textureDimensions(atlas));
        let page = clamp(floor(position.y / size.y), 0.0, f32(textureNumLayers(atlas)) - 1.0);
        let uv = vec2<f32>(position.x, position.y - page * size.y) / size;
        let uv_by_x = (by_x.xy - position * by_x.z) / (eta * size);
        let uv_by_y = (by_y.xy - position * by_y.z) / (eta * size);
        sum += eta * textureSampleGrad(atlas, atlas_sampler, uv, i32(page), uv_by_x, uv_by_y).r;
    }
    return sum;
}

@fragment
fn fragment_main(in: Varyings) -> @location(0) vec4<f32> {
    return vec4<f32>(vec3<f32>(light(in.color, in.light, dpdx(in.light), dpdy(in.light))), 1.0);
}
