//! What is baked: rays, visibility and signals.
