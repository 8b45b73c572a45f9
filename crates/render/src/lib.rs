//! Pictures of a bake, by rays on the CPU.
