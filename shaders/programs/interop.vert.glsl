// One channel from the interop form (c, 2); the fragment stage is scalar.frag.glsl. Stands behind lightkiln.vert.glsl.

uniform mat4 u_clip_from_object;
uniform vec2 u_page; // width and height of a page, in texels
uniform vec2 u_stack; // width and rows of all pages, in texels

in vec3 a_position;
in vec2 a_texcoord; // floats

out vec3 v_place;
out float v_color;

void main() {
    vec2 code = lightkilnVertexInteropScalar(a_texcoord, u_stack);
    v_place = lightkilnVertexPlace(code, u_page);
    v_color = lightkilnVertexScalar(code);
    gl_Position = u_clip_from_object * vec4(a_position, 1.0);
}
