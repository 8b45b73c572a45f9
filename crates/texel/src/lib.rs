//! Texels: lifting, baking, stitching, dilation, image formats.
