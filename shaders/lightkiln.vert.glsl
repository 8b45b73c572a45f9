// Lightkiln, vertex stage: functions for GLSL ES 3.00. CPU twin: crates/encode/src/decode.rs, `vertex`.
// Schaefer et al. 2012, sections 4.3 and 4.4.
//
// `code` is the attribute `_LIGHTUV` (or `_LIGHTUV_1` ...): two unsigned 16-bit integers, bound as floats and NOT
// normalized, so 0 .. 65535.
//   color-vertex     y >= COLOR_FLAG; 31 bits of color: 16 in x, 15 in y
//   texture-vertex   x = u * SUBTEXELS, y = v * SUBTEXELS, in texels; v runs through the stack of pages

const float LIGHTKILN_COLOR_FLAG = 32768.0;
const float LIGHTKILN_COLOR_STEPS = 65535.0;
const float LIGHTKILN_SUBTEXELS = 8.0;
const float LIGHTKILN_INTEROP_COLOR = 2.0;
const uint LIGHTKILN_LOW_BITS = 16u;
const uvec3 LIGHTKILN_RGB_SHIFTS = uvec3(21u, 10u, 0u);
const uvec3 LIGHTKILN_RGB_STEPS = uvec3(1023u, 2047u, 1023u);
const uint LIGHTKILN_TABLE_WIDTH = 256u;

// What follows computes first and chooses then: a branch around a few instructions costs more than they do.
bool lightkilnVertexIsColor(vec2 code) {
    return code.y >= LIGHTKILN_COLOR_FLAG;
}

// UV in pages, and eta: to be interpolated. The same for all layers of a bake. `page`: width and height of one, in texels.
vec3 lightkilnVertexPlace(vec2 code, vec2 page) {
    vec2 uv = code / (LIGHTKILN_SUBTEXELS * page);
    return lightkilnVertexIsColor(code) ? vec3(0.0) : vec3(uv, 1.0);
}

// The color of a layer of one channel: to be interpolated.
float lightkilnVertexScalar(vec2 code) {
    float color = code.x / LIGHTKILN_COLOR_STEPS;
    return lightkilnVertexIsColor(code) ? color : 0.0;
}

uint lightkilnVertexBits(vec2 code) {
    return (uint(code.y) - uint(LIGHTKILN_COLOR_FLAG)) << LIGHTKILN_LOW_BITS | uint(code.x);
}

// The color of a layer of two or three channels: to be interpolated.
vec3 lightkilnVertexRgb(vec2 code) {
    uvec3 steps = uvec3(lightkilnVertexBits(code)) >> LIGHTKILN_RGB_SHIFTS & LIGHTKILN_RGB_STEPS;
    vec3 color = vec3(steps) / vec3(LIGHTKILN_RGB_STEPS);
    return lightkilnVertexIsColor(code) ? color : vec3(0.0);
}

// The color of a layer with a table (not sRGB, no mip levels): to be interpolated.
vec3 lightkilnVertexTable(highp sampler2D table, vec2 code) {
    if (!lightkilnVertexIsColor(code)) {
        return vec3(0.0);
    }
    uint index = lightkilnVertexBits(code);
    return texelFetch(table, ivec2(index % LIGHTKILN_TABLE_WIDTH, index / LIGHTKILN_TABLE_WIDTH), 0).rgb;
}

// The interop form as a code: a pair of floats, (c, 2) at color-vertices and elsewhere a place in the unit square of
// the stack of pages, `stack` being its width and rows in texels. This is for one channel, c = value.
vec2 lightkilnVertexInteropScalar(vec2 pair, vec2 stack) {
    return pair.y >= LIGHTKILN_INTEROP_COLOR
        ? vec2(pair.x * LIGHTKILN_COLOR_STEPS, LIGHTKILN_COLOR_FLAG)
        : pair * stack * LIGHTKILN_SUBTEXELS;
}

// The interop form as a code, for RGB (the low bits, 2 + the high bits) and for tables (index, 2).
vec2 lightkilnVertexInterop(vec2 pair, vec2 stack) {
    return pair.y >= LIGHTKILN_INTEROP_COLOR
        ? vec2(pair.x, pair.y - LIGHTKILN_INTEROP_COLOR + LIGHTKILN_COLOR_FLAG)
        : pair * stack * LIGHTKILN_SUBTEXELS;
}
