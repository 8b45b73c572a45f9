// Programs around the functions of shaders/: nothing here decodes light by itself.

import { VERTEX, FRAGMENT } from './lightkiln.js'

const HEAD = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp sampler2DArray;
`

/** Where attributes lie, in all programs but that of harmonics, whose codes begin at that of the one. */
export const ATTRIBUTES = { position: 0, normal: 1, base: 2, chart: 3, code: 4, fallback: 5, uv: 13 }

/** Where a vertex stands: in the scene, or in the atlas. */
const STAND = `
uniform mat4 clipFromWorld;
uniform bool inAtlas;
uniform vec4 atlasView;
vec4 stand(vec3 position, vec2 place) {
    return inAtlas ? vec4((place - atlasView.xy) * atlasView.zw, 0.0, 1.0) : clipFromWorld * vec4(position, 1.0);
}
`

/** What the material says of a point: its color, linear, and whether there is anything. */
const MATERIAL = `
in vec4 vBase;
in vec2 vUv;
uniform sampler2D picture;
uniform float cutoff;
vec4 material() {
    return vBase * texture(picture, vUv);
}
`

const SURFACE_VERTEX = `${HEAD}${VERTEX}${STAND}
in vec3 position;
in vec3 normal;
in vec4 base;
in vec2 uv;
in uint chart;
in vec2 code;
in vec3 fallback;
uniform int form;
uniform sampler2D table;
out vec3 vWorld;
out vec3 vNormal;
out vec4 vBase;
out vec2 vUv;
out vec3 vColor;
out vec3 vPlace;
out vec3 vFallback;
flat out uint vChart;
flat out int vVertex;
void main() {
    vWorld = position;
    vNormal = normal;
    vBase = vec4(base.rgb * base.rgb, base.a);
    vUv = uv;
    vFallback = fallback;
    vChart = chart;
    vVertex = gl_VertexID;
    vPlace = lightkilnVertexPlace(code, vec2(1.0)); // in texels
    if (form == 0) {
        vColor = vec3(lightkilnVertexScalar(code));
    } else if (form == 1) {
        vColor = lightkilnVertexRgb(code);
    } else {
        vColor = lightkilnVertexTable(table, code);
    }
    gl_Position = stand(position, vPlace.xy);
}
`

const SHARED = `
vec3 inPages(highp sampler2DArray atlas, vec3 place) {
    return vec3(place.xy / vec2(textureSize(atlas, 0).xy), place.z);
}
vec3 encoded(vec3 linear) {
    vec3 x = clamp(linear, 0.0, 1.0);
    return mix(1.055 * pow(x, vec3(1.0 / 2.4)) - 0.055, 12.92 * x, lessThanEqual(x, vec3(0.0031308)));
}
// Where vertices have no normal, that of the triangle.
vec3 normalAt(vec3 normal, vec3 world) {
    vec3 x = dFdx(world), y = dFdy(world);
    vec3 own = cross(x / max(length(x), 1e-30), y / max(length(y), 1e-30));
    return normalize(dot(normal, normal) > 0.1 ? normal : (gl_FrontFacing ? own : -own) + vec3(0.0, 1e-9, 0.0));
}
vec3 diverging(float t) {
    // From blue over white to red, for -1 to 1.
    vec3 end = t > 0.0 ? vec3(0.62, 0.03, 0.02) : vec3(0.02, 0.12, 0.52);
    return mix(vec3(0.9), end, clamp(abs(t), 0.0, 1.0));
}
`

const LOOK = `
// What a unit value looks like: bounded values as a share of their range or clamp, light as a share of white.
uniform vec3 scale;
uniform vec2 ends;
uniform bool isSigned;
uniform float exposure;
vec3 look(vec3 unit) {
    vec3 value = lightkilnLightUnscaleRgb(unit, scale);
    vec3 share = (lightkilnLightClampRgb(value, ends) - ends.x) / (ends.y - ends.x);
    vec3 light = value / max(scale.z, 1e-30) * exposure;
    return scale.z > 0.0 ? (isSigned ? 0.5 + 0.5 * light : light) : share;
}
`

const SURFACE_FRAGMENT = `${HEAD}${FRAGMENT}${SHARED}${LOOK}${MATERIAL}
in vec3 vWorld;
in vec3 vNormal;
in vec3 vColor;
in vec3 vPlace;
in vec3 vFallback;
flat in uint vChart;
uniform sampler2DArray atlas;
uniform vec3 eye;
uniform bool one;
uniform bool materials;
uniform int source;
uniform int overlay;
uniform float texelSize;
uniform bool inAtlas;
out vec4 color;

float checker(vec2 texels) {
    vec2 cell = floor(texels / 2.0);
    return mod(cell.x + cell.y, 2.0) < 0.5 ? 1.0 : 0.72;
}

vec3 hashed(uint x) {
    x = (x ^ (x >> 16u)) * 0x7feb352du;
    x = (x ^ (x >> 15u)) * 0x846ca68bu;
    x ^= x >> 16u;
    return 0.25 + 0.65 * vec3(x & 255u, (x >> 8u) & 255u, (x >> 16u) & 255u) / 255.0;
}

void main() {
    vec3 texel = lightkilnLightRgb(atlas, vec3(0.0), inPages(atlas, vPlace));
    vec3 placeX = dFdx(vPlace), placeY = dFdy(vPlace);
    vec3 across = cross(dFdx(vWorld), dFdy(vWorld));
    vec3 normal = normalAt(vNormal, vWorld);
    vec4 own = material();
    if (!inAtlas && own.a < cutoff) discard;
    float clay = 0.15 + 0.6 * abs(dot(normal, normalize(eye - vWorld))) + 0.25 * (0.5 + 0.5 * normal.y);

    vec3 shown = look(vColor + (one ? texel.rrr : texel));
    // What has a range is seen as it is; with the colors of dark materials it may need more.
    bool isLight = scale.z > 0.0;
    if (source == 1) shown = isLight ? vFallback * exposure : vFallback;
    if (source == 2) shown = vec3(clay);
    if (materials) shown *= isLight ? own.rgb : own.rgb * exposure;

    float eta = vPlace.z;
    vec2 place = vPlace.xy / max(eta, 1e-6);
    float shade = inAtlas ? 1.0 : 0.35 + 0.65 * clay;
    if (overlay == 1) {
        shown = eta > 0.999999 ? vec3(0.85, 0.12, 0.10) : eta < 1e-6 ? vec3(0.75, 0.80, 0.85) : vec3(0.95, 0.65, 0.10);
        shown *= shade;
    } else if (overlay == 2) {
        shown = eta > 0.999999 && vChart > 0u ? hashed(vChart) * checker(place) : vec3(0.75, 0.80, 0.85);
        shown *= shade;
    } else if (overlay == 3) {
        shown = vec3(0.3);
        if (eta > 0.999999) {
            float texels = abs(placeX.x * placeY.y - placeX.y * placeY.x);
            float area = max(length(across), 1e-30);
            // Texels along a length, in shares of what was asked for; the color's scale is doubling.
            shown = diverging(log2(sqrt(texels / area) * texelSize)) * checker(place);
        }
        shown *= shade;
    } else if (overlay == 4) {
        // Between the points nothing is known: as bright as they are, so that theirs are the colors that are seen.
        shown = vec3(0.62) * shade;
    }
    color = vec4(encoded(shown), 1.0);
}
`

const PICK_FRAGMENT = `${HEAD}${MATERIAL}
in vec3 vWorld;
in vec3 vPlace;
flat in int vVertex;
uniform bool inAtlas;
out uvec4 found;
void main() {
    if (!inAtlas && material().a < cutoff) discard;
    vec3 at = inAtlas ? vec3(vPlace.xy, 0.0) : vWorld;
    found = uvec4(uint(vVertex) + 1u, floatBitsToUint(at));
}
`

const LINE_VERTEX = `${HEAD}${VERTEX}${STAND}
in vec3 position;
in vec2 code;
uniform float pull;
void main() {
    gl_Position = stand(position, lightkilnVertexPlace(code, vec2(1.0)).xy);
    gl_Position.z -= pull * gl_Position.w;
}
`

const LINE_FRAGMENT = `${HEAD}
uniform vec4 paint;
out vec4 color;
void main() {
    color = vec4(paint.rgb * paint.a, paint.a);
}
`

const ERROR_VERTEX = `${HEAD}
in vec4 position;
in vec4 normal;
uniform mat4 clipFromWorld;
uniform vec3 eye;
uniform float pixels;
uniform float spacing;
uniform float limit;
out float vError;
out float vShade;
void main() {
    vError = position.w / limit;
    // Form without hiding what the colors say.
    vShade = 0.72 + 0.28 * abs(dot(normalize(normal.xyz), normalize(eye - position.xyz)));
    gl_Position = clipFromWorld * vec4(position.xyz, 1.0);
    gl_PointSize = clamp(spacing * pixels / gl_Position.w, 1.5, 64.0);
    // Toward the eye by half of its width, so that a disc is not cut by the surface that it lies on.
    gl_Position.z -= gl_Position.w * 2e-4;
    bool behind = normal.w < 0.5 && dot(normal.xyz, eye - position.xyz) < 0.0;
    if (behind) gl_Position = vec4(0.0, 0.0, 2.0, 1.0);
}
`

const ERROR_FRAGMENT = `${HEAD}${SHARED}
in float vError;
in float vShade;
out vec4 color;
void main() {
    vec2 from = gl_PointCoord - 0.5;
    if (dot(from, from) > 0.25) discard;
    color = vec4(encoded(diverging(vError) * vShade), 1.0);
}
`

const ATLAS_VERTEX = `${HEAD}
const vec2 CORNERS[3] = vec2[3](vec2(-1.0, -1.0), vec2(3.0, -1.0), vec2(-1.0, 3.0));
uniform vec4 atlasView;
out vec2 vTexel;
void main() {
    vec2 corner = CORNERS[gl_VertexID];
    vTexel = corner / atlasView.zw + atlasView.xy;
    gl_Position = vec4(corner, 0.0, 1.0);
}
`

const ATLAS_FRAGMENT = `${HEAD}${FRAGMENT}${SHARED}${LOOK}
in vec2 vTexel;
uniform sampler2DArray atlas;
uniform bool one;
uniform float dim;
out vec4 color;
void main() {
    ivec3 size = textureSize(atlas, 0);
    ivec2 at = ivec2(floor(vTexel));
    if (any(lessThan(at, ivec2(0))) || at.x >= size.x || at.y >= size.y * size.z) {
        color = vec4(0.16, 0.18, 0.21, 1.0);
        return;
    }
    vec3 unit = texelFetch(atlas, ivec3(at.x, at.y % size.y, at.y / size.y), 0).rgb;
    color = vec4(encoded(look(one ? unit.rrr : unit) * dim), 1.0);
}
`

/** Irradiance at the normals of the vertices, from 4 or 9 layers that are looked at together. */
export function harmonics(gl, count) {
  const each = (line) => [...Array(count).keys()].map(line).join('\n')
  const vertex = `${HEAD}${VERTEX}
in vec3 position;
in vec3 normal;
in vec4 base;
in vec2 uv;
${each((k) => `in vec2 code${k};\nout vec3 vColor${k};`)}
uniform mat4 clipFromWorld;
out vec3 vWorld;
out vec3 vNormal;
out vec4 vBase;
out vec2 vUv;
out vec3 vPlace;
void main() {
    vWorld = position;
    vNormal = normal;
    vBase = vec4(base.rgb * base.rgb, base.a);
    vUv = uv;
    vPlace = lightkilnVertexPlace(code0, vec2(1.0));
${each((k) => `    vColor${k} = lightkilnVertexRgb(code${k});`)}
    gl_Position = clipFromWorld * vec4(position, 1.0);
}
`
  const fragment = `${HEAD}${FRAGMENT}${SHARED}${MATERIAL}
in vec3 vWorld;
in vec3 vNormal;
in vec3 vPlace;
${each((k) => `in vec3 vColor${k};\nuniform sampler2DArray atlas${k};\nuniform vec3 scale${k};`)}
uniform bool materials;
uniform float exposure;
out vec4 color;
void main() {
    vec4 own = material();
    if (own.a < cutoff) discard;
    vec3 place = inPages(atlas0, vPlace);
    vec3 sh[${count}];
${each((k) => `    sh[${k}] = lightkilnLightUnscaleRgb(lightkilnLightRgb(atlas${k}, vColor${k}, place), scale${k});`)}
    vec3 light = lightkilnLightSh${count === 4 ? 1 : 2}(sh, normalAt(vNormal, vWorld));
    vec3 shown = light / (0.282095 * scale0.z) * exposure;
    color = vec4(encoded(materials ? shown * own.rgb : shown), 1.0);
}
`
  const codes = [...Array(count).keys()].map((k) => [`code${k}`, ATTRIBUTES.code + k])
  return program(gl, vertex, fragment, { position: ATTRIBUTES.position, normal: ATTRIBUTES.normal, base: ATTRIBUTES.base, uv: ATTRIBUTES.uv, ...Object.fromEntries(codes) })
}

/** All other programs, each with its uniforms by name. */
export function programs(gl) {
  return {
    surface: program(gl, SURFACE_VERTEX, SURFACE_FRAGMENT),
    pick: program(gl, SURFACE_VERTEX, PICK_FRAGMENT),
    line: program(gl, LINE_VERTEX, LINE_FRAGMENT),
    error: program(gl, ERROR_VERTEX, ERROR_FRAGMENT),
    atlas: program(gl, ATLAS_VERTEX, ATLAS_FRAGMENT),
  }
}

function program(gl, vertex, fragment, attributes = ATTRIBUTES) {
  const made = gl.createProgram()
  for (const [type, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(type)
    gl.shaderSource(shader, text)
    gl.compileShader(shader)
    gl.attachShader(made, shader)
  }
  for (const [name, location] of Object.entries(attributes)) gl.bindAttribLocation(made, location, name)
  gl.linkProgram(made)
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) {
    const logs = gl.getAttachedShaders(made).map((shader) => gl.getShaderInfoLog(shader))
    throw new Error([gl.getProgramInfoLog(made), ...logs].filter(Boolean).join('\n'))
  }
  const uniforms = {}
  const count = gl.getProgramParameter(made, gl.ACTIVE_UNIFORMS)
  for (let i = 0; i < count; i++) {
    const { name } = gl.getActiveUniform(made, i)
    uniforms[name] = gl.getUniformLocation(made, name)
  }
  return { made, uniforms }
}
