//! One packed attribute per vertex, and the decoder that is the shader's CPU twin.
