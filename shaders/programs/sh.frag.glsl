// Irradiance for normal maps, four layers of RGB. Stands behind lightkiln.frag.glsl.

uniform vec3 u_scale[4]; // of each layer
uniform LIGHTKILN_ATLAS u_atlas_0;
uniform LIGHTKILN_ATLAS u_atlas_1;
uniform LIGHTKILN_ATLAS u_atlas_2;
uniform LIGHTKILN_ATLAS u_atlas_3;

in vec3 v_place;
in vec3 v_normal; // in world space; from a normal map where there is one
in vec3 v_sh0;
in vec3 v_sh1;
in vec3 v_sh2;
in vec3 v_sh3;

out vec4 o_color;

void main() {
    vec3 sh[4];
    sh[0] = lightkilnLightUnscaleRgb(lightkilnLightRgb(u_atlas_0, v_sh0, v_place), u_scale[0]);
    sh[1] = lightkilnLightUnscaleRgb(lightkilnLightRgb(u_atlas_1, v_sh1, v_place), u_scale[1]);
    sh[2] = lightkilnLightUnscaleRgb(lightkilnLightRgb(u_atlas_2, v_sh2, v_place), u_scale[2]);
    sh[3] = lightkilnLightUnscaleRgb(lightkilnLightRgb(u_atlas_3, v_sh3, v_place), u_scale[3]);
    o_color = vec4(lightkilnLightSh1(sh, normalize(v_normal)), 1.0);
}
