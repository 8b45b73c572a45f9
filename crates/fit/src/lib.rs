//! Least-squares vertex values.
