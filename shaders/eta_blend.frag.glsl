#version 300 es
// The eta-blend, fragment stage: C + eta * tex(UV / eta). Schaefer et al. 2012, section 4.3; CPU twin:
// crates/encode/src/decode.rs, `fragment` and `AtlasView::lookup`.
precision highp float;
precision highp sampler2DArray;

const float ETA_EPSILON = 0.0000152587890625;

uniform sampler2DArray u_atlas; // one layer per page; LINEAR, CLAMP_TO_EDGE

in vec3 v_light; // UV in texels, and eta
in float v_color; // C

out vec4 o_light;

// `by_x` and `by_y` are the derivatives of `at`. They must be taken where all pixels pass: inside the branch
// derivatives are undefined, and those of UV / eta follow from them by the quotient rule.
float light(float color, vec3 at, vec3 by_x, vec3 by_y) {
    float sum = color;
    float eta = at.z;
    if (eta > ETA_EPSILON) {
        vec2 position = at.xy / eta;
        vec3 size = vec3(textureSize(u_atlas, 0));
        float page = clamp(floor(position.y / size.y), 0.0, size.z - 1.0);
        vec2 uv = vec2(position.x, position.y - page * size.y) / size.xy;
        vec2 uv_by_x = (by_x.xy - position * by_x.z) / (eta * size.xy);
        vec2 uv_by_y = (by_y.xy - position * by_y.z) / (eta * size.xy);
        sum += eta * textureGrad(u_atlas, vec3(uv, page), uv_by_x, uv_by_y).r;
    }
    return sum;
}

void main() {
    o_light = vec4(vec3(light(v_color, v_light, dFdx(v_light), dFdy(v_light))), 1.0);
}
