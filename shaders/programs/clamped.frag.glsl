// One channel that is clamped after interpolation. Stands behind lightkiln.frag.glsl.

uniform vec3 u_scale; // low, high - low, 0
uniform vec2 u_clamp; // of the layer
uniform LIGHTKILN_ATLAS u_atlas;

in vec3 v_place;
in float v_color;

out vec4 o_color;

void main() {
    float unit = lightkilnLightScalar(u_atlas, v_color, v_place);
    float light = lightkilnLightUnscale(unit, u_scale);
    o_color = vec4(vec3(lightkilnLightClamp(light, u_clamp)), 1.0);
}
