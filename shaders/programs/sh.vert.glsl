// Irradiance for normal maps, four layers of RGB. Stands behind lightkiln.vert.glsl.
//
// All layers of a bake share their places, so one varying serves them.

uniform mat4 u_clip_from_object;
uniform vec2 u_page; // width and height of a page, in texels

in vec3 a_position;
in vec3 a_normal;
in vec2 a_lightuv; // irradianceSh0; unsigned 16-bit integers as floats, not normalized
in vec2 a_lightuv_1;
in vec2 a_lightuv_2;
in vec2 a_lightuv_3;

out vec3 v_place;
out vec3 v_normal;
out vec3 v_sh0;
out vec3 v_sh1;
out vec3 v_sh2;
out vec3 v_sh3;

void main() {
    v_place = lightkilnVertexPlace(a_lightuv, u_page);
    v_normal = a_normal;
    v_sh0 = lightkilnVertexRgb(a_lightuv);
    v_sh1 = lightkilnVertexRgb(a_lightuv_1);
    v_sh2 = lightkilnVertexRgb(a_lightuv_2);
    v_sh3 = lightkilnVertexRgb(a_lightuv_3);
    gl_Position = u_clip_from_object * vec4(a_position, 1.0);
}
