// Lightkiln: functions of both stages. Schaefer et al. 2012, sections 4.3 and 4.4; CPU twin: crates/encode/src/decode.rs
// and crates/light/src/harmonics.rs. The comments of the GLSL files apply.
//
// `code` is the attribute `_LIGHTUV` (or `_LIGHTUV_1` ...), vertex format uint16x2.

const LIGHTKILN_COLOR_FLAG: u32 = 32768u;
const LIGHTKILN_COLOR_STEPS: f32 = 65535.0;
const LIGHTKILN_SUBTEXELS: f32 = 8.0;
const LIGHTKILN_INTEROP_COLOR: f32 = 2.0;
const LIGHTKILN_LOW_BITS: u32 = 16u;
const LIGHTKILN_RGB_SHIFTS: vec3<u32> = vec3(21u, 10u, 0u);
const LIGHTKILN_RGB_STEPS: vec3<u32> = vec3(1023u, 2047u, 1023u);
const LIGHTKILN_TABLE_WIDTH: u32 = 256u;

const LIGHTKILN_ETA_EPSILON: f32 = 0.0000152587890625;
const LIGHTKILN_CURVE_KNEE: f32 = 15.0;
const LIGHTKILN_CURVE_BASE: f32 = 16.0;
const LIGHTKILN_SH_CONSTANT: f32 = 0.28209479177387814;
const LIGHTKILN_SH_LINEAR: f32 = 0.4886025119029199;
const LIGHTKILN_SH_PRODUCT: f32 = 1.0925484305920792;
const LIGHTKILN_SH_AXIS: f32 = 0.31539156525252005;
const LIGHTKILN_SH_DIFFERENCE: f32 = 0.5462742152960396;

// Vertex stage.

fn lightkilnVertexIsColor(code: vec2<u32>) -> bool {
    return code.y >= LIGHTKILN_COLOR_FLAG;
}

// UV in pages, and eta: to be interpolated. The same for all layers of a bake. `page`: width and height of one, in texels.
fn lightkilnVertexPlace(code: vec2<u32>, page: vec2<f32>) -> vec3<f32> {
    let place = vec3<f32>(vec2<f32>(code) / (LIGHTKILN_SUBTEXELS * page), 1.0);
    return select(place, vec3<f32>(0.0), lightkilnVertexIsColor(code));
}

// The color of a layer of one channel: to be interpolated.
fn lightkilnVertexScalar(code: vec2<u32>) -> f32 {
    return select(0.0, f32(code.x) / LIGHTKILN_COLOR_STEPS, lightkilnVertexIsColor(code));
}

fn lightkilnVertexBits(code: vec2<u32>) -> u32 {
    return ((code.y - LIGHTKILN_COLOR_FLAG) << LIGHTKILN_LOW_BITS) | code.x;
}

// The color of a layer of two or three channels: to be interpolated.
fn lightkilnVertexRgb(code: vec2<u32>) -> vec3<f32> {
    let color = (vec3<u32>(lightkilnVertexBits(code)) >> LIGHTKILN_RGB_SHIFTS) & LIGHTKILN_RGB_STEPS;
    return select(
        vec3<f32>(0.0),
        vec3<f32>(color) / vec3<f32>(LIGHTKILN_RGB_STEPS),
        lightkilnVertexIsColor(code),
    );
}

// The color of a layer with a table (not sRGB, no mip levels): to be interpolated.
fn lightkilnVertexTable(table: texture_2d<f32>, code: vec2<u32>) -> vec3<f32> {
    if !lightkilnVertexIsColor(code) {
        return vec3<f32>(0.0);
    }
    let index = lightkilnVertexBits(code);
    return textureLoad(table, vec2(index % LIGHTKILN_TABLE_WIDTH, index / LIGHTKILN_TABLE_WIDTH), 0).rgb;
}

// The interop form as a code, for one channel: (value, 2), or a place in the unit square of the stack of pages.
fn lightkilnVertexInteropScalar(pair: vec2<f32>, stack: vec2<f32>) -> vec2<u32> {
    let color = vec2<u32>(u32(round(pair.x * LIGHTKILN_COLOR_STEPS)), LIGHTKILN_COLOR_FLAG);
    let place = vec2<u32>(round(pair * stack * LIGHTKILN_SUBTEXELS));
    return select(place, color, pair.y >= LIGHTKILN_INTEROP_COLOR);
}

// The interop form as a code, for RGB (the low bits, 2 + the high bits) and for tables (index, 2).
fn lightkilnVertexInterop(pair: vec2<f32>, stack: vec2<f32>) -> vec2<u32> {
    let color = vec2<u32>(u32(pair.x), u32(pair.y - LIGHTKILN_INTEROP_COLOR) + LIGHTKILN_COLOR_FLAG);
    let place = vec2<u32>(round(pair * stack * LIGHTKILN_SUBTEXELS));
    return select(place, color, pair.y >= LIGHTKILN_INTEROP_COLOR);
}

// Fragment stage.

// tex(UV / eta), for the two functions behind it. `by_x` and `by_y` are derivatives of `place`: those of UV / eta follow by the
// quotient rule, and the level from those, for a lookup with a level costs less than one with gradients.
fn lightkilnLightTexel(atlas: texture_2d_array<f32>, linear: sampler, place: vec3<f32>, by_x: vec3<f32>, by_y: vec3<f32>) -> vec3<f32> {
    let share = 1.0 / place.z;
    let uv = place.xy * share;
    let page = clamp(floor(uv.y), 0.0, f32(textureNumLayers(atlas)) - 1.0);
    let texels = vec2<f32>(textureDimensions(atlas)) * share;
    let texels_by_x = (by_x.xy - uv * by_x.z) * texels;
    let texels_by_y = (by_y.xy - uv * by_y.z) * texels;
    let steps = max(dot(texels_by_x, texels_by_x), dot(texels_by_y, texels_by_y));
    let level = log2(max(1.0, steps)) / 2.0;
    return textureSampleLevel(atlas, linear, vec2<f32>(uv.x, uv.y - page), i32(page), level).rgb;
}

// The unit value of a layer of one channel. `place` is interpolated from `lightkilnVertexPlace`, `color` from
// `lightkilnVertexScalar`. To be called where all pixels pass: derivatives are undefined inside of branches.
fn lightkilnLightScalar(atlas: texture_2d_array<f32>, linear: sampler, color: f32, place: vec3<f32>) -> f32 {
    let by_x = dpdx(place);
    let by_y = dpdy(place);
    if place.z <= LIGHTKILN_ETA_EPSILON {
        return color;
    }
    return color + place.z * lightkilnLightTexel(atlas, linear, place, by_x, by_y).r;
}

// The unit value of a layer of two or three channels. `color` is interpolated from `lightkilnVertexRgb` or `..Table`.
fn lightkilnLightRgb(atlas: texture_2d_array<f32>, linear: sampler, color: vec3<f32>, place: vec3<f32>) -> vec3<f32> {
    let by_x = dpdx(place);
    let by_y = dpdy(place);
    if place.z <= LIGHTKILN_ETA_EPSILON {
        return color;
    }
    return color + place.z * lightkilnLightTexel(atlas, linear, place, by_x, by_y);
}

// The two for an atlas that is one page and has no mip levels. They may be called anywhere.
fn lightkilnLightScalarPlain(atlas: texture_2d<f32>, linear: sampler, color: f32, place: vec3<f32>) -> f32 {
    if place.z <= LIGHTKILN_ETA_EPSILON {
        return color;
    }
    return color + place.z * textureSampleLevel(atlas, linear, place.xy / place.z, 0.0).r;
}

fn lightkilnLightRgbPlain(atlas: texture_2d<f32>, linear: sampler, color: vec3<f32>, place: vec3<f32>) -> vec3<f32> {
    if place.z <= LIGHTKILN_ETA_EPSILON {
        return color;
    }
    return color + place.z * textureSampleLevel(atlas, linear, place.xy / place.z, 0.0).rgb;
}

// From a unit value to the signal's unit. `scale`: P(low), P(high) - P(low), and white (0: the curve is linear).
fn lightkilnLightUnscale(unit: f32, scale: vec3<f32>) -> f32 {
    let p = scale.x + unit * scale.y;
    if scale.z <= 0.0 {
        return p;
    }
    return sign(p) * (pow(LIGHTKILN_CURVE_BASE, abs(p)) - 1.0) * (scale.z / LIGHTKILN_CURVE_KNEE);
}

fn lightkilnLightUnscaleRgb(unit: vec3<f32>, scale: vec3<f32>) -> vec3<f32> {
    let p = scale.x + unit * scale.y;
    if scale.z <= 0.0 {
        return p;
    }
    return sign(p) * (pow(vec3<f32>(LIGHTKILN_CURVE_BASE), abs(p)) - 1.0) * (scale.z / LIGHTKILN_CURVE_KNEE);
}

// For layers with a `clamp` in the file, after unscaling: `ends` are its two numbers. (Kavan et al. 2011, section 3.3)
fn lightkilnLightClamp(light: f32, ends: vec2<f32>) -> f32 {
    return clamp(light, ends.x, ends.y);
}

fn lightkilnLightClampRgb(light: vec3<f32>, ends: vec2<f32>) -> vec3<f32> {
    return clamp(light, vec3<f32>(ends.x), vec3<f32>(ends.y));
}

// Irradiance that arrives at a unit normal (of a normal map, in world space), from the layers irradianceSh0 to 3, unscaled.
fn lightkilnLightSh1(sh: array<vec3<f32>, 4>, normal: vec3<f32>) -> vec3<f32> {
    let light = LIGHTKILN_SH_CONSTANT * sh[0]
        + LIGHTKILN_SH_LINEAR * (sh[1] * normal.y + sh[2] * normal.z + sh[3] * normal.x);
    return max(light, vec3<f32>(0.0));
}

// As before, from irradianceSh0 to 8.
fn lightkilnLightSh2(sh: array<vec3<f32>, 9>, normal: vec3<f32>) -> vec3<f32> {
    let n = normal;
    let light = LIGHTKILN_SH_CONSTANT * sh[0]
        + LIGHTKILN_SH_LINEAR * (sh[1] * n.y + sh[2] * n.z + sh[3] * n.x)
        + LIGHTKILN_SH_PRODUCT * (sh[4] * (n.x * n.y) + sh[5] * (n.y * n.z) + sh[7] * (n.x * n.z))
        + LIGHTKILN_SH_AXIS * sh[6] * (3.0 * n.z * n.z - 1.0)
        + LIGHTKILN_SH_DIFFERENCE * sh[8] * (n.x * n.x - n.y * n.y);
    return max(light, vec3<f32>(0.0));
}
