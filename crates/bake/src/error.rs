//! What can stop a bake.

use lightkiln_mesh::MeshError;

/// What can stop a bake: a stage's own error, or a request that makes no sense.
#[derive(Debug, thiserror::Error)]
pub enum BakeError {
    /// The file could not be read or written.
    #[error(transparent)]
    Scene(#[from] lightkiln_scene::SceneError),
    /// The scene has no triangle with an area.
    #[error("{file} has no triangles to bake")]
    NothingToBake {
        /// The file's name.
        file: String,
    },
    /// The scene has triangles, and none of them is to get light.
    #[error("all parts of {file} are left out: none gets light")]
    AllLeftOut {
        /// The file's name.
        file: String,
    },
    /// The file carries no light of ours.
    #[error("{file} carries no LIGHTKILN_lightmap extension")]
    NotBaked {
        /// The file's name.
        file: String,
    },
    /// The scene does not carry the signal that was asked for.
    #[error("the scene has no {what}")]
    NoSignal {
        /// What it has not.
        what: String,
    },
    /// An option is out of its range.
    #[error("{name} is {value}, but must be {range}")]
    Option {
        /// The option.
        name: &'static str,
        /// The value given.
        value: String,
        /// What it may be.
        range: &'static str,
    },
    /// The profile cannot hold what was asked for.
    #[error("the profile {profile} cannot hold {what}")]
    Profile {
        /// Its name.
        profile: &'static str,
        /// What it cannot hold.
        what: String,
        /// What to do.
        remedy: &'static str,
    },
    /// The file that was just written does not read back as it was meant.
    #[error("the written file shows something else than what was baked: {what}")]
    ReadBack {
        /// What differs.
        what: String,
    },
    /// Whoever watches the bake has stopped it; nothing was written.
    #[error("the bake was cancelled, and nothing was written")]
    Cancelled,
    /// A file beside the scene could not be written.
    #[error("cannot write {path}: {source}", path = path.display())]
    Write {
        /// The file.
        path: std::path::PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The denoiser that was asked for is not there.
    #[error("{why}")]
    NoDenoiser {
        /// What is missing.
        why: String,
        /// What to do.
        remedy: &'static str,
    },
    /// The denoiser refused its work.
    #[error("{why}")]
    DenoiserFailed {
        /// What it says.
        why: String,
        /// What to do.
        remedy: &'static str,
    },
    /// The light mesh could not be made.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// Rays, or lights that make no sense.
    #[error(transparent)]
    Light(#[from] lightkiln_light::LightError),
    /// An area light has a number that makes no sense.
    #[error("area light {number}, counted from 0: bad {what}")]
    AreaLight {
        /// Which of the area lights.
        number: usize,
        /// What of it.
        what: &'static str,
    },
    /// An image of the surroundings makes no sense.
    #[error("{path}: {source}", path = path.display())]
    Environment {
        /// The image.
        path: std::path::PathBuf,
        /// What is wrong with it.
        source: lightkiln_light::LightError,
    },
    /// Samples.
    #[error(transparent)]
    Sample(#[from] lightkiln_sample::SampleError),
    /// Vertex values.
    #[error(transparent)]
    Fit(#[from] lightkiln_fit::FitError),
    /// Charts.
    #[error(transparent)]
    Chart(#[from] lightkiln_chart::ChartError),
    /// Texels.
    #[error(transparent)]
    Texel(#[from] lightkiln_texel::TexelError),
    /// Packing.
    #[error(transparent)]
    Pack(#[from] lightkiln_chart::pack::PackError),
    /// Image files.
    #[error(transparent)]
    Image(#[from] lightkiln_texel::ImageError),
    /// Codes.
    #[error(transparent)]
    Encode(#[from] lightkiln_encode::EncodeError),
}

impl BakeError {
    /// What the user can do about it.
    pub fn remedy(&self) -> Option<String> {
        match self {
            Self::Scene(error) => Some(error.remedy().to_owned()),
            Self::NothingToBake { .. } => {
                Some("name another scene with --scene, or check that its nodes draw triangles".into())
            }
            Self::AllLeftOut { .. } => Some(
                "widen --include, narrow --exclude, try --moving keep, or look for `receive` in the file's extras"
                    .into(),
            ),
            Self::NotBaked { .. } => Some("bake it first: lightkiln bake IN.glb -o OUT.glb".into()),
            Self::NoSignal { .. } => Some(
                "choose another --signal; what --replace took out of a file cannot be verified against it"
                    .into(),
            ),
            Self::Profile { remedy, .. }
            | Self::NoDenoiser { remedy, .. }
            | Self::DenoiserFailed { remedy, .. } => Some((*remedy).to_owned()),
            Self::Light(_) => {
                Some("mend the light that is named, in the file or in the configuration".into())
            }
            Self::AreaLight { .. } => {
                Some("mend it in the configuration file, under [[light.area-lights]]".into())
            }
            Self::Environment { .. } => Some("choose an image that shines, with finite values".into()),
            Self::Sample(_) => Some("ask for a larger --detail or fewer --samples".into()),
            Self::Chart(_) | Self::Pack(_) | Self::Encode(_) => {
                Some("ask for a larger --detail or a larger --max-error".into())
            }
            Self::ReadBack { .. } => {
                Some("this is a fault of lightkiln: please report it with the file".into())
            }
            _ => None,
        }
    }
}
