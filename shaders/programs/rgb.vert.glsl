// Two or three channels, such as irradiance. Stands behind lightkiln.vert.glsl.

uniform mat4 u_clip_from_object;
uniform vec2 u_page; // width and height of a page, in texels

in vec3 a_position;
in vec2 a_lightuv; // unsigned 16-bit integers as floats, not normalized

out vec3 v_place;
out vec3 v_color;

void main() {
    v_place = lightkilnVertexPlace(a_lightuv, u_page);
    v_color = lightkilnVertexRgb(a_lightuv);
    gl_Position = u_clip_from_object * vec4(a_position, 1.0);
}
