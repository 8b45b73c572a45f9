// Lightkiln, fragment stage: functions for GLSL ES 3.00. Schaefer et al. 2012, section 4.3; CPU twin:
// crates/encode/src/decode.rs, `fragment`, `AtlasView::lookup`, `unscale` and `clamp`, and crates/light/src/harmonics.rs.
//
// Each layer: `unit = C + eta * tex(UV / eta)`, then the way back from unit values to the signal's own unit.
// The atlas has one layer per page: LINEAR, CLAMP_TO_EDGE, not sRGB.
//
// Two macros make the lookup cheaper where they hold: LIGHTKILN_ONE_PAGE, the atlas is one page, and a sampler2D in the place of
// a sampler2DArray; LIGHTKILN_ONE_LEVEL, it has no mip levels, and its filter no anisotropy.

#ifdef LIGHTKILN_ONE_PAGE
#define LIGHTKILN_ATLAS highp sampler2D
#else
#define LIGHTKILN_ATLAS highp sampler2DArray
#endif

const float LIGHTKILN_ETA_EPSILON = 0.0000152587890625;
const float LIGHTKILN_CURVE_KNEE = 15.0;
const float LIGHTKILN_CURVE_BASE = 16.0;
const float LIGHTKILN_SH_CONSTANT = 0.28209479177387814;
const float LIGHTKILN_SH_LINEAR = 0.4886025119029199;
const float LIGHTKILN_SH_PRODUCT = 1.0925484305920792;
const float LIGHTKILN_SH_AXIS = 0.31539156525252005;
const float LIGHTKILN_SH_DIFFERENCE = 0.5462742152960396;

// tex(UV / eta), for the two functions behind it. `byX` and `byY` are derivatives of `place`: those of UV / eta follow by the
// quotient rule, and the level from those, for a lookup with a level costs less than one with gradients. Without mip levels there is
// none to choose: nothing depends on derivatives, and a plain lookup will do.
vec3 lightkilnLightTexel(LIGHTKILN_ATLAS atlas, vec3 place, vec3 byX, vec3 byY) {
    float share = 1.0 / place.z;
    vec2 uv = place.xy * share;
#ifdef LIGHTKILN_ONE_PAGE
    vec2 at = uv;
#else
    float page = clamp(floor(uv.y), 0.0, float(textureSize(atlas, 0).z - 1));
    vec3 at = vec3(uv.x, uv.y - page, page);
#endif
#ifdef LIGHTKILN_ONE_LEVEL
    return texture(atlas, at).rgb;
#else
    vec2 texels = vec2(textureSize(atlas, 0).xy) * share;
    vec2 texelsByX = (byX.xy - uv * byX.z) * texels;
    vec2 texelsByY = (byY.xy - uv * byY.z) * texels;
    float level = log2(max(1.0, max(dot(texelsByX, texelsByX), dot(texelsByY, texelsByY)))) / 2.0;
    return textureLod(atlas, at, level).rgb;
#endif
}

// The unit value of a layer of one channel. `place` is interpolated from `lightkilnVertexPlace`, `color` from
// `lightkilnVertexScalar`. To be called where all pixels pass: derivatives are undefined inside of branches.
float lightkilnLightScalar(LIGHTKILN_ATLAS atlas, float color, vec3 place) {
    vec3 byX = dFdx(place);
    vec3 byY = dFdy(place);
    if (place.z > LIGHTKILN_ETA_EPSILON) {
        color += place.z * lightkilnLightTexel(atlas, place, byX, byY).r;
    }
    return color;
}

// The unit value of a layer of two or three channels. `color` is interpolated from `lightkilnVertexRgb` or `..Table`.
vec3 lightkilnLightRgb(LIGHTKILN_ATLAS atlas, vec3 color, vec3 place) {
    vec3 byX = dFdx(place);
    vec3 byY = dFdy(place);
    if (place.z > LIGHTKILN_ETA_EPSILON) {
        color += place.z * lightkilnLightTexel(atlas, place, byX, byY);
    }
    return color;
}

// From a unit value to the signal's unit. `scale`: P(low), P(high) - P(low), and white (0: the curve is linear).
float lightkilnLightUnscale(float unit, vec3 scale) {
    float p = scale.x + unit * scale.y;
    if (scale.z <= 0.0) {
        return p;
    }
    return sign(p) * (pow(LIGHTKILN_CURVE_BASE, abs(p)) - 1.0) * (scale.z / LIGHTKILN_CURVE_KNEE);
}

vec3 lightkilnLightUnscaleRgb(vec3 unit, vec3 scale) {
    vec3 p = scale.x + unit * scale.y;
    if (scale.z <= 0.0) {
        return p;
    }
    return sign(p) * (pow(vec3(LIGHTKILN_CURVE_BASE), abs(p)) - 1.0) * (scale.z / LIGHTKILN_CURVE_KNEE);
}

// For layers with a `clamp` in the file, after unscaling: `ends` are its two numbers. (Kavan et al. 2011, section 3.3)
float lightkilnLightClamp(float light, vec2 ends) {
    return clamp(light, ends.x, ends.y);
}

vec3 lightkilnLightClampRgb(vec3 light, vec2 ends) {
    return clamp(light, ends.x, ends.y);
}

// Irradiance that arrives at a unit normal (of a normal map, in world space), from the layers irradianceSh0 to 3, unscaled.
vec3 lightkilnLightSh1(vec3 sh[4], vec3 normal) {
    vec3 light = LIGHTKILN_SH_CONSTANT * sh[0]
        + LIGHTKILN_SH_LINEAR * (sh[1] * normal.y + sh[2] * normal.z + sh[3] * normal.x);
    return max(light, 0.0);
}

// As before, from irradianceSh0 to 8.
vec3 lightkilnLightSh2(vec3 sh[9], vec3 normal) {
    vec3 n = normal;
    vec3 light = LIGHTKILN_SH_CONSTANT * sh[0]
        + LIGHTKILN_SH_LINEAR * (sh[1] * n.y + sh[2] * n.z + sh[3] * n.x)
        + LIGHTKILN_SH_PRODUCT * (sh[4] * (n.x * n.y) + sh[5] * (n.y * n.z) + sh[7] * (n.x * n.z))
        + LIGHTKILN_SH_AXIS * sh[6] * (3.0 * n.z * n.z - 1.0)
        + LIGHTKILN_SH_DIFFERENCE * sh[8] * (n.x * n.x - n.y * n.y);
    return max(light, 0.0);
}
