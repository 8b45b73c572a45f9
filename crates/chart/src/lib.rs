//! Charts: segmentation, parameterization, packing.
