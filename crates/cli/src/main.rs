//! The `lightkiln` program.
fn main() {}
