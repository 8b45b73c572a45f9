// Entry points of every form, one pair each. Stands behind ../lightkiln.wgsl.

struct Camera {
    clip_from_object: mat4x4<f32>,
}

struct Layers {
    scale: array<vec4<f32>, 4>, // of each layer: P(low), P(high) - P(low), white, unused
    stack: vec2<f32>, // width and rows of all pages in texels; for the interop form
    ends: vec2<f32>, // of a layer with `clamp`
    page: vec2<f32>, // width and height of a page in texels
}

@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<uniform> layers: Layers;
@group(0) @binding(2) var linear_sampler: sampler; // linear, clamp-to-edge
@group(0) @binding(3) var table: texture_2d<f32>;
@group(1) @binding(0) var atlas_0: texture_2d_array<f32>; // one layer per page
@group(1) @binding(1) var atlas_1: texture_2d_array<f32>;
@group(1) @binding(2) var atlas_2: texture_2d_array<f32>;
@group(1) @binding(3) var atlas_3: texture_2d_array<f32>;
@group(1) @binding(4) var plain: texture_2d<f32>; // one page without mip levels

fn clip(position: vec3<f32>) -> vec4<f32> {
    return camera.clip_from_object * vec4<f32>(position, 1.0);
}

// One channel, such as ambient occlusion.

struct Scalar {
    @builtin(position) clip: vec4<f32>,
    @location(0) place: vec3<f32>,
    @location(1) color: f32,
}

@vertex
fn vertex_scalar(@location(0) position: vec3<f32>, @location(1) code: vec2<u32>) -> Scalar {
    return Scalar(clip(position), lightkilnVertexPlace(code, layers.page), lightkilnVertexScalar(code));
}

// The interop form (c, 2) of one channel.
@vertex
fn vertex_interop(@location(0) position: vec3<f32>, @location(1) texcoord: vec2<f32>) -> Scalar {
    let code = lightkilnVertexInteropScalar(texcoord, layers.stack);
    return Scalar(clip(position), lightkilnVertexPlace(code, layers.page), lightkilnVertexScalar(code));
}

@fragment
fn fragment_scalar(in: Scalar) -> @location(0) vec4<f32> {
    let unit = lightkilnLightScalar(atlas_0, linear_sampler, in.color, in.place);
    return vec4<f32>(vec3<f32>(lightkilnLightUnscale(unit, layers.scale[0].xyz)), 1.0);
}

// One channel, of an atlas that is one page without mip levels.
@fragment
fn fragment_plain(in: Scalar) -> @location(0) vec4<f32> {
    let unit = lightkilnLightScalarPlain(plain, linear_sampler, in.color, in.place);
    return vec4<f32>(vec3<f32>(lightkilnLightUnscale(unit, layers.scale[0].xyz)), 1.0);
}

// One channel that is clamped after interpolation.
@fragment
fn fragment_clamped(in: Scalar) -> @location(0) vec4<f32> {
    let unit = lightkilnLightScalar(atlas_0, linear_sampler, in.color, in.place);
    let light = lightkilnLightUnscale(unit, layers.scale[0].xyz);
    return vec4<f32>(vec3<f32>(lightkilnLightClamp(light, layers.ends)), 1.0);
}

// Two or three channels, such as irradiance.

struct Rgb {
    @builtin(position) clip: vec4<f32>,
    @location(0) place: vec3<f32>,
    @location(1) color: vec3<f32>,
}

@vertex
fn vertex_rgb(@location(0) position: vec3<f32>, @location(1) code: vec2<u32>) -> Rgb {
    return Rgb(clip(position), lightkilnVertexPlace(code, layers.page), lightkilnVertexRgb(code));
}

@vertex
fn vertex_table(@location(0) position: vec3<f32>, @location(1) code: vec2<u32>) -> Rgb {
    return Rgb(clip(position), lightkilnVertexPlace(code, layers.page), lightkilnVertexTable(table, code));
}

@fragment
fn fragment_rgb(in: Rgb) -> @location(0) vec4<f32> {
    let unit = lightkilnLightRgb(atlas_0, linear_sampler, in.color, in.place);
    // Irradiance in lux. A material shows albedo / pi times it, and the camera's exposure.
    return vec4<f32>(lightkilnLightUnscaleRgb(unit, layers.scale[0].xyz), 1.0);
}

// Three channels that are clamped after interpolation, such as bent normals.
@fragment
fn fragment_clamped_rgb(in: Rgb) -> @location(0) vec4<f32> {
    let unit = lightkilnLightRgb(atlas_0, linear_sampler, in.color, in.place);
    let light = lightkilnLightUnscaleRgb(unit, layers.scale[0].xyz);
    return vec4<f32>(lightkilnLightClampRgb(light, layers.ends), 1.0);
}

// Irradiance for normal maps, four layers of RGB. All layers of a bake share their places.

struct Sh {
    @builtin(position) clip: vec4<f32>,
    @location(0) place: vec3<f32>,
    @location(1) normal: vec3<f32>, // in world space; from a normal map where there is one
    @location(2) sh0: vec3<f32>,
    @location(3) sh1: vec3<f32>,
    @location(4) sh2: vec3<f32>,
    @location(5) sh3: vec3<f32>,
}

@vertex
fn vertex_sh(
    @location(0) position: vec3<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) code_0: vec2<u32>,
    @location(3) code_1: vec2<u32>,
    @location(4) code_2: vec2<u32>,
    @location(5) code_3: vec2<u32>,
) -> Sh {
    return Sh(
        clip(position),
        lightkilnVertexPlace(code_0, layers.page),
        normal,
        lightkilnVertexRgb(code_0),
        lightkilnVertexRgb(code_1),
        lightkilnVertexRgb(code_2),
        lightkilnVertexRgb(code_3),
    );
}

@fragment
fn fragment_sh(in: Sh) -> @location(0) vec4<f32> {
    let sh = array<vec3<f32>, 4>(
        lightkilnLightUnscaleRgb(lightkilnLightRgb(atlas_0, linear_sampler, in.sh0, in.place), layers.scale[0].xyz),
        lightkilnLightUnscaleRgb(lightkilnLightRgb(atlas_1, linear_sampler, in.sh1, in.place), layers.scale[1].xyz),
        lightkilnLightUnscaleRgb(lightkilnLightRgb(atlas_2, linear_sampler, in.sh2, in.place), layers.scale[2].xyz),
        lightkilnLightUnscaleRgb(lightkilnLightRgb(atlas_3, linear_sampler, in.sh3, in.place), layers.scale[3].xyz),
    );
    return vec4<f32>(lightkilnLightSh1(sh, normalize(in.normal)), 1.0);
}
