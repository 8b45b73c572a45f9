//! Texture triangles and color triangles.
