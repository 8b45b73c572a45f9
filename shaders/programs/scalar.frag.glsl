// One channel. Stands behind lightkiln.frag.glsl.

uniform vec3 u_scale; // 0, 1, 0 for a linear range of 0 to 1
uniform LIGHTKILN_ATLAS u_atlas;

in vec3 v_place;
in float v_color;

out vec4 o_color;

void main() {
    float unit = lightkilnLightScalar(u_atlas, v_color, v_place);
    o_color = vec4(vec3(lightkilnLightUnscale(unit, u_scale)), 1.0);
}
