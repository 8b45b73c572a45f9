// Any channels, colors in a table; the fragment stage is rgb.frag.glsl. Stands behind lightkiln.vert.glsl.

uniform mat4 u_clip_from_object;
uniform vec2 u_page; // width and height of a page, in texels
uniform highp sampler2D u_table; // NEAREST, not sRGB, no mip levels

in vec3 a_position;
in vec2 a_lightuv; // unsigned 16-bit integers as floats, not normalized

out vec3 v_place;
out vec3 v_color;

void main() {
    v_place = lightkilnVertexPlace(a_lightuv, u_page);
    v_color = lightkilnVertexTable(u_table, a_lightuv);
    gl_Position = u_clip_from_object * vec4(a_position, 1.0);
}
