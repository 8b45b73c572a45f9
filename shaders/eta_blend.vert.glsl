#version 300 es
// The eta-blend, vertex stage. Schaefer et al. 2012, section 4.3; CPU twin: crates/encode/src/decode.rs, `vertex`.
//
// `_LIGHTUV`: two unsigned 16-bit integers, bound as floats and NOT normalized, so 0 .. 65535.
//   color-vertex     x = value * COLOR_STEPS   y >= COLOR_FLAG
//   texture-vertex   x = u * SUBTEXELS         y = v * SUBTEXELS, in texels; v runs through the stack of pages
precision highp float;

const float COLOR_FLAG = 32768.0;
const float COLOR_STEPS = 65535.0;
const float SUBTEXELS = 8.0;

uniform mat4 u_clip_from_object;

in vec3 a_position;
in vec2 a_lightuv;

out vec3 v_light; // UV in texels, and eta
out float v_color; // C

void main() {
    bool is_color = a_lightuv.y >= COLOR_FLAG;
    v_color = is_color ? a_lightuv.x / COLOR_STEPS : 0.0;
    v_light = is_color ? vec3(0.0) : vec3(a_lightuv / SUBTEXELS, 1.0);

    gl_Position = u_clip_from_object * vec4(a_position, 1.0);
}
