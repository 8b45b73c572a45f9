//! Poisson-disk points on surfaces.
