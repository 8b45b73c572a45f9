//! What can go wrong.

/// What keeps a picture from being made.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// A camera cannot see.
    #[error("the camera makes no sense: {what}")]
    Camera {
        /// What is wrong with it.
        what: &'static str,
    },
    /// The PNG encoder refused.
    #[error("png: {0}")]
    Png(#[from] png::EncodingError),
}
