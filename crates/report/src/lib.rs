//! Bytes and errors.
