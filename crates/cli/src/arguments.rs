//! The command line, and the configuration file that may stand in for parts of it.
//!
//! A value on the command line wins over the file, the file over the default. Keys of the file are the long
//! options without their dashes; an unknown key is an error.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use lightkiln_bake::lighting::{AuthoredOcclusion, LightOptions};
use lightkiln_bake::options::BakeBounds;
use lightkiln_bake::signals::{SIGNALS, Signals};
use lightkiln_bake::{BakeOptions, Denoiser, Quality};
use lightkiln_scene::{Fallback, Profile};
use serde::{Deserialize, Serialize};

use crate::light::LightSettings;
use crate::messages::{Exit, Failure};

/// Bakes light onto glTF meshes in the fewest bytes that keep an error bound.
#[derive(Parser)]
#[command(version, about, after_help = EXIT_CODES, disable_help_subcommand = true)]
pub struct Arguments {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

const EXIT_CODES: &str = "\
Exit codes: 0 done; 1 wrong arguments; 2 a file cannot be read or written; 3 the input is invalid;
4 the bake failed; 5 the input needs something unsupported; 6 the error bound does not hold;
7 the byte budget is exceeded; 130 the bake was cancelled, and nothing was written.";

/// What to do.
#[derive(Subcommand)]
pub enum Command {
    /// Bake light onto a scene and write it with a report of its bytes and errors
    Bake(Box<Bake>),
    /// Print what a baked or unbaked file costs on the GPU
    Inspect(Inspect),
    /// Decode a baked file as the GPU shows it and compare with freshly traced light
    Verify(Verify),
    /// Make a picture of a scene or of its baked light, without a GPU
    Render(Box<crate::pictures::Render>),
    /// Look at a baked file in a browser, or write the page as a static site
    View(crate::view::View),
    /// Fit vertices alone by every method and print what each costs
    Compare(crate::vertices::Compare),
    /// Fit vertices alone with several weights of a regularizer, with pictures
    Fit(Box<crate::vertices::Fit>),
}

/// Arguments of `bake`.
#[derive(Args)]
pub struct Bake {
    /// Scene to bake: .gltf or .glb
    pub input: PathBuf,
    /// Baked scene to write: .gltf or .glb
    #[arg(short, long)]
    pub output: PathBuf,
    #[command(flatten)]
    pub settings: BakeSettings,
    /// Read settings from a TOML file; the command line wins
    #[arg(long, value_name = "FILE.toml")]
    pub config: Option<PathBuf>,
    /// Print the settings as TOML with every given value filled in, and stop
    #[arg(long)]
    pub print_config: bool,
    /// Write the report: as a page with pictures for a name in .html, else as JSON; may be given twice
    #[arg(long, value_name = "R.json|R.html")]
    pub report: Vec<PathBuf>,
    /// Write a Make-style dependency file: all outputs, and every file that was read
    #[arg(long, value_name = "D")]
    pub depfile: Option<PathBuf>,
    /// Show the bake in a browser while it goes on, on this port of 127.0.0.1 [default: any that is free]. The page can
    /// cancel it, as Ctrl-C does; afterwards it shows the file until it is closed, or for ten seconds if none was opened
    #[arg(long, value_name = "PORT", num_args = 0..=1, require_equals = true, default_missing_value = "0")]
    pub preview: Option<u16>,
    #[command(flatten)]
    pub common: Common,
}

/// What every command that computes takes.
#[derive(Args, Clone, Copy, Default)]
pub struct Common {
    /// Threads; all cores by default. The result does not depend on it
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// No progress and no table: errors and warnings only
    #[arg(short, long)]
    pub quiet: bool,
    /// Print the result as JSON
    #[arg(long)]
    pub json: bool,
}

/// Everything about a bake that may also stand in a configuration file.
#[derive(Args, Clone, Debug, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct BakeSettings {
    /// What to bake: one signal, or several with + between them [default: ao]
    #[arg(long, value_name = "SIGNAL", long_help = format!("What to bake [default: ao]; several with + between them share samples and the atlas:\n{SIGNALS}"))]
    #[serde(default, with = "signals_as_text")]
    pub signal: Option<Signals>,
    /// Largest error, as a share of the signal's range [default: 0.03]
    #[arg(long, value_name = "E")]
    pub max_error: Option<f32>,
    /// Smallest feature to keep, in metres (units of the file) [default: from the number of samples]
    #[arg(long, value_name = "METRES", conflicts_with = "samples")]
    pub detail: Option<f32>,
    /// About so many samples over the surface [default: by quality, 75k, 250k or 1M]
    #[arg(long, value_name = "N")]
    pub samples: Option<usize>,
    /// How much work to do [default: normal]
    #[arg(long, value_enum)]
    pub quality: Option<QualityName>,
    /// What takes the noise out of light in lux [default: own]
    #[arg(long, value_enum)]
    pub denoiser: Option<DenoiserName>,
    /// Occluders farther away do not count, in metres, or `inf` [default: a tenth of the scene's diagonal]
    #[arg(long, value_name = "METRES")]
    pub ao_distance: Option<f32>,
    /// Seed of all random numbers [default: 0]
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
    /// How the light stands in the file [default: eta]
    #[arg(long, value_enum)]
    pub profile: Option<ProfileName>,
    /// Occlusion textures that the file has already, with --profile stock or lightmap [default: multiply]
    #[arg(long, value_enum)]
    pub authored_occlusion: Option<AuthoredName>,
    /// What viewers see that do not know the extension [default: color0]
    #[arg(long, value_enum)]
    pub fallback: Option<FallbackName>,
    /// Which scene of the file to bake [default: the file's default scene]
    #[arg(long, value_name = "N")]
    pub scene: Option<usize>,
    /// Fail with exit code 7 when the light takes more than this on the GPU, such as 2MiB or 500kB
    #[arg(long, value_name = "BYTES")]
    pub max_bytes: Option<ByteCount>,
    /// Also write the atlas as OpenEXR beside the output
    #[arg(long)]
    #[serde(default)]
    pub exr: bool,
    /// Also write the atlas as KTX2 beside the output: shared exponents (RGB9E5) for light, halves for the rest
    #[arg(long)]
    #[serde(default)]
    pub ktx2: bool,
    /// Store vertex colors as entries of a table, not packed into the attribute
    #[arg(long)]
    #[serde(default)]
    pub table: bool,
    /// What keeps occlusion, shadows and textures within their range; `clamp-after` needs viewers that honour it
    /// [default: clamp]
    #[arg(long, value_enum)]
    pub bounds: Option<BakeBoundsName>,
    /// Take the textures out of the file that the light stands for (occlusion, file-lightmap)
    #[arg(long)]
    #[serde(default)]
    pub replace: bool,
    /// Which light there is and what it meets; in a configuration file: the table [light]
    #[command(flatten)]
    #[serde(default)]
    pub light: LightSettings,
}

/// Signals in a configuration file: as on the command line.
mod signals_as_text {
    use lightkiln_bake::signals::Signals;
    use serde::{Deserialize, Deserializer, Serializer};

    pub fn serialize<S: Serializer>(signals: &Option<Signals>, serializer: S) -> Result<S::Ok, S::Error> {
        match signals {
            Some(signals) => serializer.serialize_str(&signals.to_string()),
            None => serializer.serialize_none(),
        }
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Signals>, D::Error> {
        let text = Option::<String>::deserialize(deserializer)?;
        text.map(|text| text.parse().map_err(serde::de::Error::custom)).transpose()
    }
}

/// Names of [`Quality`] on the command line.
#[derive(Clone, Copy, Debug, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum QualityName {
    /// Seconds: for a first look
    Draft,
    /// The default
    Normal,
    /// For delivery
    Final,
}

impl From<QualityName> for Quality {
    fn from(name: QualityName) -> Self {
        match name {
            QualityName::Draft => Self::Draft,
            QualityName::Normal => Self::Normal,
            QualityName::Final => Self::Final,
        }
    }
}

/// Names of [`Denoiser`] on the command line.
#[derive(Clone, Copy, Debug, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DenoiserName {
    /// Lightkiln's own filter over surfaces
    Own,
    /// Open Image Denoise for texels: a build with the feature oidn, and its library
    Oidn,
    /// Nothing: the same rays, unfiltered
    None,
}

impl From<DenoiserName> for Denoiser {
    fn from(name: DenoiserName) -> Self {
        match name {
            DenoiserName::Own => Self::Own,
            DenoiserName::Oidn => Self::Oidn,
            DenoiserName::None => Self::None,
        }
    }
}

/// Names of [`Fallback`] on the command line.
#[derive(Clone, Copy, Debug, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FallbackName {
    /// The light as vertex colors, multiplied into those that are there
    Color0,
    /// Nothing: only viewers that know the extension show light
    None,
}

/// Names of [`Profile`] on the command line.
#[derive(Clone, Copy, Debug, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ProfileName {
    /// 4 bytes a vertex and a shader of ours: the fewest bytes
    Eta,
    /// One occlusion texture that every viewer shows: charts, and a strip of all values
    Stock,
    /// As eta, as 8 bytes of texture coordinates, for engines that drop other attributes
    Texcoord,
    /// One plain full lightmap
    Lightmap,
}

impl From<ProfileName> for Profile {
    fn from(name: ProfileName) -> Self {
        match name {
            ProfileName::Eta => Self::Eta,
            ProfileName::Stock => Self::Stock,
            ProfileName::Texcoord => Self::Texcoord,
            ProfileName::Lightmap => Self::Lightmap,
        }
    }
}

/// Names of [`AuthoredOcclusion`] on the command line.
#[derive(Clone, Copy, Debug, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AuthoredName {
    /// Ours times theirs, with texels as fine as theirs
    Multiply,
    /// Ours times theirs, with texels of one width everywhere
    MultiplyCoarse,
    /// Materials that have one keep it and get no light
    Keep,
    /// Ours takes its place
    Replace,
}

impl From<AuthoredName> for AuthoredOcclusion {
    fn from(name: AuthoredName) -> Self {
        match name {
            AuthoredName::Multiply => Self::Multiply,
            AuthoredName::MultiplyCoarse => Self::MultiplyCoarse,
            AuthoredName::Keep => Self::Keep,
            AuthoredName::Replace => Self::Replace,
        }
    }
}

/// Names of [`BakeBounds`] on the command line.
#[derive(Clone, Copy, Debug, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum BakeBoundsName {
    /// Vertex values are clamped
    Clamp,
    /// Vertex values may lie beyond, and viewers clamp what they interpolate
    ClampAfter,
    /// Vertex values are those of the least error within the range
    Optimum,
}

impl From<BakeBoundsName> for BakeBounds {
    fn from(name: BakeBoundsName) -> Self {
        match name {
            BakeBoundsName::Clamp => Self::Clamp,
            BakeBoundsName::ClampAfter => Self::ClampAfter,
            BakeBoundsName::Optimum => Self::Optimum,
        }
    }
}

/// A number of bytes with an optional unit: `500kB`, `2MiB`, `1048576`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "NumberOrText", into = "String")]
pub struct ByteCount(pub u64);

/// A configuration file may leave the quotes away where there is no unit.
#[derive(Deserialize)]
#[serde(untagged, expecting = "expected a number of bytes, such as 500000 or \"2MiB\"")]
enum NumberOrText {
    Number(u64),
    Text(String),
}

impl std::str::FromStr for ByteCount {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic()).trim_end();
        let unit = text[digits.len()..].trim();
        let factor = match unit.to_ascii_lowercase().as_str() {
            "" | "b" => 1.0,
            "k" | "kb" => 1e3,
            "m" | "mb" => 1e6,
            "g" | "gb" => 1e9,
            "kib" => 1024.0,
            "mib" => 1_048_576.0,
            "gib" => 1_073_741_824.0,
            _ => return Err(format!("unknown unit {unit:?}: use B, kB, MB, GB, kiB, MiB or GiB")),
        };
        match digits.parse::<f64>() {
            Ok(number) if number.is_finite() && number >= 0.0 => Ok(Self((number * factor) as u64)),
            _ => Err(format!("{digits:?} is not a number of bytes")),
        }
    }
}

impl TryFrom<NumberOrText> for ByteCount {
    type Error = String;

    fn try_from(given: NumberOrText) -> Result<Self, String> {
        match given {
            NumberOrText::Number(bytes) => Ok(Self(bytes)),
            NumberOrText::Text(text) => text.parse(),
        }
    }
}

impl From<ByteCount> for String {
    fn from(count: ByteCount) -> Self {
        count.0.to_string()
    }
}

impl BakeSettings {
    /// These settings, with those of a file where they say nothing.
    fn or(self, file: Self) -> Self {
        // A detail on the command line overrules samples in the file, and the other way round.
        let scale_given = self.detail.is_some() || self.samples.is_some();
        Self {
            max_error: self.max_error.or(file.max_error),
            detail: self.detail.or(if scale_given { None } else { file.detail }),
            samples: self.samples.or(if scale_given { None } else { file.samples }),
            quality: self.quality.or(file.quality),
            denoiser: self.denoiser.or(file.denoiser),
            ao_distance: self.ao_distance.or(file.ao_distance),
            seed: self.seed.or(file.seed),
            profile: self.profile.or(file.profile),
            authored_occlusion: self.authored_occlusion.or(file.authored_occlusion),
            fallback: self.fallback.or(file.fallback),
            scene: self.scene.or(file.scene),
            max_bytes: self.max_bytes.or(file.max_bytes),
            exr: self.exr || file.exr,
            ktx2: self.ktx2 || file.ktx2,
            table: self.table || file.table,
            bounds: self.bounds.or(file.bounds),
            replace: self.replace || file.replace,
            signal: self.signal.or(file.signal),
            light: self.light.or(file.light),
        }
    }

    /// The options of the bake.
    pub fn options(&self) -> BakeOptions {
        let defaults = BakeOptions::default();
        BakeOptions {
            signals: self.signal.clone().unwrap_or_default(),
            light: LightOptions {
                authored_occlusion: self.authored_occlusion.map(AuthoredOcclusion::from),
                ..self.light.options()
            },
            profile: self.profile.map_or_else(Profile::default, Profile::from),
            table: self.table,
            bounds: self.bounds.map_or_else(BakeBounds::default, BakeBounds::from),
            replace: self.replace,
            max_error: self.max_error.unwrap_or(defaults.max_error),
            detail: self.detail,
            samples: self.samples,
            quality: self.quality.map_or_else(Quality::default, Quality::from),
            denoiser: self.denoiser.map_or_else(Denoiser::default, Denoiser::from),
            ao_distance: self.ao_distance,
            white: self.light.white,
            seed: self.seed.unwrap_or(defaults.seed),
            fallback: match self.fallback {
                Some(FallbackName::None) => Fallback::None,
                Some(FallbackName::Color0) | None => Fallback::Color0,
            },
            scene: self.scene,
            exr: self.exr,
            ktx2: self.ktx2,
        }
    }
}

impl Bake {
    /// The settings of the command line, completed from the configuration file.
    ///
    /// # Errors
    /// When the file cannot be read, is not TOML, or has an unknown key or a value of the wrong type.
    pub fn settings(&self) -> Result<BakeSettings, Failure> {
        let Some(path) = &self.config else { return Ok(self.settings.clone()) };
        let text = std::fs::read_to_string(path).map_err(|e| Failure::reading(path, &e))?;
        let file: BakeSettings = toml::from_str(&text).map_err(|e| {
            Failure::new(Exit::Usage, e.message().to_owned())
                .place(match e.span() {
                    Some(span) => format!("{}:{}", path.display(), 1 + text[..span.start].matches('\n').count()),
                    None => path.display().to_string(),
                })
                .remedy("keys are the long options of `lightkiln bake` without dashes; see `lightkiln bake --help`")
        })?;
        if file.detail.is_some() && file.samples.is_some() {
            return Err(Failure::new(Exit::Usage, "detail and samples exclude each other")
                .place(path.display().to_string())
                .remedy("keep one of them"));
        }
        Ok(self.settings.clone().or(file))
    }
}

/// Arguments of `inspect`.
#[derive(Args)]
pub struct Inspect {
    /// A .gltf or .glb file
    pub file: PathBuf,
    /// Fail with exit code 7 when the light takes more than this on the GPU, such as 2MiB or 500kB
    #[arg(long, value_name = "BYTES")]
    pub max_bytes: Option<ByteCount>,
    /// Print the result as JSON
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `verify`.
#[derive(Args)]
pub struct Verify {
    /// A baked .gltf or .glb file
    pub file: PathBuf,
    /// Fresh points to trace
    #[arg(long, value_name = "N", default_value_t = 50_000, value_parser = clap::value_parser!(u32).range(1..=100_000_000))]
    pub points: u32,
    /// Rays of each reference
    #[arg(long, value_name = "N", default_value_t = 1024, value_parser = clap::value_parser!(u32).range(32..=1_000_000))]
    pub rays: u32,
    /// Seed of the points and rays; the bake used others
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Which scene of the file [default: the file's default scene]
    #[arg(long, value_name = "N")]
    pub scene: Option<usize>,
    /// The surroundings of the bake, where they lie elsewhere than the file says
    #[arg(long, value_name = "FILE")]
    pub environment: Option<PathBuf>,
    #[command(flatten)]
    pub common: Common,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arguments_definition_is_consistent() {
        use clap::CommandFactory;
        Arguments::command().debug_assert();
    }

    #[test]
    fn byte_count_reads_units() {
        assert_eq!("2MiB".parse(), Ok(ByteCount(2_097_152)));
        assert_eq!("500 kB".parse(), Ok(ByteCount(500_000)));
        assert_eq!("1048576".parse(), Ok(ByteCount(1_048_576)));
        assert!("2 parsecs".parse::<ByteCount>().is_err());
        assert!("-1".parse::<ByteCount>().is_err());
        assert!("MiB".parse::<ByteCount>().is_err());
    }

    #[test]
    fn settings_command_line_wins_over_file() {
        let file: BakeSettings =
            toml::from_str("max-error = 0.01\ndetail = 0.5\nmax-bytes = \"2MiB\"\nquality = \"draft\"")
                .unwrap();
        let line = BakeSettings { samples: Some(10), max_error: Some(0.02), ..Default::default() };
        let both = line.or(file);
        assert_eq!((both.max_error, both.detail, both.samples), (Some(0.02), None, Some(10)));
        assert_eq!(both.max_bytes, Some(ByteCount(2_097_152)));
    }

    #[test]
    fn settings_max_bytes_with_or_without_quotes() {
        let read = |text: &str| toml::from_str::<BakeSettings>(text).map(|s| s.max_bytes);
        assert_eq!(read("max-bytes = 500000").unwrap(), Some(ByteCount(500_000)));
        assert_eq!(read("max-bytes = \"500 kB\"").unwrap(), Some(ByteCount(500_000)));
        assert!(read("max-bytes = -1").unwrap_err().message().contains("number of bytes"));
    }

    #[test]
    fn settings_unknown_key_is_refused() {
        assert!(toml::from_str::<BakeSettings>("maxerror = 0.01").is_err());
    }
}
