//! The project's own scenes, made by code.
