// Three channels, such as irradiance. Stands behind lightkiln.frag.glsl.

uniform vec3 u_scale; // P(low), P(high) - P(low), white
uniform LIGHTKILN_ATLAS u_atlas;

in vec3 v_place;
in vec3 v_color;

out vec4 o_color;

void main() {
    vec3 unit = lightkilnLightRgb(u_atlas, v_color, v_place);
    // Irradiance in lux. A material shows albedo / pi times it, and the camera's exposure.
    o_color = vec4(lightkilnLightUnscaleRgb(unit, u_scale), 1.0);
}
