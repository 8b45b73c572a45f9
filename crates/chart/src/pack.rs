//! Packing: places charts in the pages of the atlas.
