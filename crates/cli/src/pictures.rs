//! The command `render`: pictures of files, as one image.

use std::io::Cursor;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use glam::{Vec3, Vec4};
use lightkiln_bake::{Clock, file_name};
use lightkiln_render::picture::BACKGROUND;
use lightkiln_render::sheet::{Legend, Panel, columns, sheet};
use lightkiln_render::{Picture, Tone, View};
use lightkiln_scene::srgb;
use lightkiln_texel::{ExrDepth, ExrLayer, write_exr_layers};

use crate::arguments::Common;
use crate::commands::use_threads;
use crate::files::{check_outputs, write_whole};
use crate::messages::{Exit, Failure};
use crate::progress::Stages;
use crate::shaded::Exposure;
use crate::stations::{MOST_PIXELS, Station, Stations, xyz};
use crate::studio::{Look, ModeName, Values, in_studio};

/// Arguments of `render`.
#[derive(Args)]
pub struct Render {
    /// .gltf or .glb files
    #[arg(required = true)]
    pub files: Vec<PathBuf>,
    /// Picture to write: .png, or .exr for numbers
    #[arg(short, long)]
    pub output: PathBuf,
    /// What to show: one mode, or several separated by commas
    #[arg(long, value_enum, value_delimiter = ',', default_value = "light")]
    pub mode: Vec<ModeName>,
    /// Where to look from: front, back, left, right, top, bottom, three-quarter, or AZIMUTH,ELEVATION in degrees;
    /// several separated by commas [default: three-quarter]
    #[arg(long, value_name = "VIEW", allow_hyphen_values = true)]
    pub view: Vec<String>,
    /// Look through a camera of the file, by its name or number; may be given more than once
    #[arg(long, value_name = "NAME|N")]
    pub camera: Vec<String>,
    /// Look from this place
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = xyz)]
    pub eye: Option<Vec3>,
    /// What --eye looks at [default: the middle of the scene]
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = xyz, requires = "eye")]
    pub look: Option<Vec3>,
    /// Angle from the lower to the upper edge of the picture in degrees [default: 28 of views, 45 of --eye, that of a
    /// camera]
    #[arg(long, value_name = "DEGREES", value_parser = angle)]
    pub fov: Option<f32>,
    /// 2 shows half as much of the scene, and so on
    #[arg(long, default_value_t = 1.0)]
    pub zoom: f32,
    /// Views look at this point instead of the middle of the scene
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = xyz)]
    pub target: Option<Vec3>,
    /// Width and height of one picture in pixels; square, or of the shape of the camera, if only the width is given
    #[arg(long, value_name = "W[xH]", default_value = "1024", value_parser = size)]
    pub size: Size,
    /// Rays per pixel for modes that trace light
    #[arg(long, default_value_t = 256, value_parser = clap::value_parser!(u32).range(16..=65536))]
    pub rays: u32,
    /// What is seen behind everything: red, green and blue, 0 to 1 as a screen has them, or `transparent`
    #[arg(long, value_name = "R,G,B|transparent", value_parser = background)]
    pub background: Option<Background>,
    /// Which scene of the file [default: the file's default scene]
    #[arg(long, value_name = "N")]
    pub scene: Option<usize>,
    /// Which layer of the light, from 0
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub layer: usize,
    /// Shaded modes: doublings of brightness
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true)]
    pub exposure: f32,
    /// Shaded modes: what makes a white surface white, in lux [default: that of the bake]
    #[arg(long, value_name = "LUX")]
    pub white: Option<f32>,
    /// Shaded modes: what becomes of light that is brighter than a screen
    #[arg(long, value_enum, default_value = "neutral")]
    pub tone: ToneName,
    /// Pictures in a row of a sheet [default: modes, or places with one mode; a single line of more than six wraps]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub columns: Option<u16>,
    /// Captions and legends on single pictures too
    #[arg(long)]
    pub captions: bool,
    /// No captions and legends on sheets
    #[arg(long, conflicts_with = "captions")]
    pub no_captions: bool,
    #[command(flatten)]
    pub common: Common,
}

/// Names of [`Tone`] on the command line.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum ToneName {
    /// Khronos PBR Neutral: base colors stay as they are, highlights are compressed
    Neutral,
    /// Cut off at 1
    Clip,
}

impl From<ToneName> for Tone {
    fn from(name: ToneName) -> Self {
        match name {
            ToneName::Neutral => Self::Neutral,
            ToneName::Clip => Self::Clip,
        }
    }
}

/// Width, and height if it is given.
#[derive(Clone, Copy, Debug)]
pub struct Size {
    width: usize,
    height: Option<usize>,
}

/// What is seen behind everything.
#[derive(Clone, Copy, Debug)]
pub enum Background {
    /// Nothing.
    Transparent,
    /// A color, linear.
    Color(Vec3),
}

fn angle(text: &str) -> Result<f32, String> {
    let degrees = text.trim().parse().ok().filter(|&degrees: &f32| degrees > 0.0 && degrees < 180.0);
    degrees.ok_or_else(|| "it must be above 0 and below 180 degrees".to_owned())
}

fn size(text: &str) -> Result<Size, String> {
    let number = |text: &str| text.trim().parse().ok().filter(|n| (16..=MOST_PIXELS).contains(n));
    let read = match text.split_once('x') {
        None => number(text).map(|width| Size { width, height: None }),
        Some((width, height)) => {
            number(width).zip(number(height)).map(|(width, height)| Size { width, height: Some(height) })
        }
    };
    read.ok_or_else(|| format!("write it as WIDTH or WIDTHxHEIGHT, each from 16 to {MOST_PIXELS}"))
}

fn background(text: &str) -> Result<Background, String> {
    if text == "transparent" {
        return Ok(Background::Transparent);
    }
    match xyz(text) {
        Ok(color) if color.min_element() >= 0.0 && color.max_element() <= 1.0 => {
            Ok(Background::Color(Vec3::from_array(color.to_array().map(srgb::linear))))
        }
        _ => Err("write it as R,G,B, each from 0 to 1, or transparent".to_owned()),
    }
}

/// Endings of the name of a picture.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Ending {
    Png,
    Exr,
}

impl Ending {
    fn of(path: &Path) -> Result<Self, Failure> {
        let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
        match ending.as_deref() {
            Some("png") => Ok(Self::Png),
            Some("exr") => Ok(Self::Exr),
            _ => Err(Failure::new(Exit::Usage, "the output ends neither in .png nor in .exr")
                .place(path.display().to_string())
                .remedy("name it NAME.png for a screen, NAME.exr for numbers")),
        }
    }
}

/// A picture, and what of.
struct Shown {
    file: String,
    station: String,
    mode: ModeName,
    picture: Picture,
    legend: Option<Legend>,
}

/// Renders what was asked for into one image.
///
/// # Errors
/// A file that cannot be read or written, a place to look from that is none, a mode that needs a baked file.
pub fn run(arguments: &Render) -> Result<Exit, Failure> {
    let ending = Ending::of(&arguments.output)?;
    let inputs: Vec<&Path> = arguments.files.iter().map(PathBuf::as_path).collect();
    check_outputs(&inputs, &[&arguments.output])?;
    let stations = arguments.stations()?;
    use_threads(&arguments.common)?;
    let stages = Stages::new(arguments.common.quiet);
    let mut clock = Clock::new(&stages);
    let mut all = Vec::new();
    for file in &arguments.files {
        let shown = arguments.pictures(file, &stations, ending, &mut clock);
        all.extend(shown.map_err(|failure| failure.or_in(file))?);
    }
    stages.finish();
    let bytes = match ending {
        Ending::Png => arguments.png(all)?,
        Ending::Exr => arguments.exr(&all)?,
    };
    write_whole(&arguments.output, &bytes)?;
    Ok(Exit::Done)
}

impl Render {
    fn stations(&self) -> Result<Stations, Failure> {
        if !(self.zoom.is_finite() && self.zoom > 0.0) {
            let what = format!("--zoom is {}, but must be above 0", self.zoom);
            return Err(Failure::new(Exit::Usage, what).remedy("2 shows half as much of the scene"));
        }
        let bad = |what: String| Err(Failure::new(Exit::Usage, what));
        if !(self.exposure.is_finite() && self.exposure.abs() <= 30.0) {
            return bad(format!("--exposure is {}, but must lie between -30 and 30", self.exposure));
        }
        if let Some(white) = self.white.filter(|white| !(white.is_finite() && *white > 0.0)) {
            return bad(format!("--white is {white}, but must be above 0"));
        }
        let mut list = Vec::new();
        for text in &self.view {
            let views = View::parse_list(text).ok_or_else(|| {
                let names = View::NAMES.map(|(name, _)| name).join(", ");
                Failure::new(Exit::Usage, format!("{text:?} is no view"))
                    .remedy(format!("use {names}, or AZIMUTH,ELEVATION in degrees"))
            })?;
            list.extend(views.into_iter().map(|(name, view)| (name, Station::Orbit(view))));
        }
        list.extend(self.camera.iter().map(|name| (name.clone(), Station::Camera(name.clone()))));
        list.extend(self.eye.map(|eye| ("eye".to_owned(), Station::Eye(eye, self.look))));
        if list.is_empty() {
            list.push(("three-quarter".to_owned(), Station::Orbit(View::THREE_QUARTER)));
        }
        Ok(Stations {
            list,
            target: self.target,
            angle: self.fov.map(f32::to_radians),
            zoom: self.zoom,
            width: self.size.width,
            height: self.size.height,
        })
    }

    /// The pictures of a file: all modes from the first station, then from the next.
    fn pictures(
        &self,
        file: &Path,
        stations: &Stations,
        ending: Ending,
        clock: &mut Clock<'_>,
    ) -> Result<Vec<Shown>, Failure> {
        let look = Look {
            file,
            scene: self.scene,
            layer: self.layer,
            rays: self.rays,
            values: if ending == Ending::Exr { Values::Signal } else { Values::Screen },
            exposure: Exposure { stops: self.exposure, white: self.white, tone: self.tone.into() },
            modes: &self.mode,
        };
        // A background of numbers would be taken for light.
        let background = self.background.unwrap_or(match ending {
            Ending::Png => Background::Color(BACKGROUND),
            Ending::Exr => Background::Transparent,
        });
        in_studio(&look, clock, |studio, clock| {
            let shots = stations.shots(studio.surface.scene, self.scene, &studio.surface.mesh)?;
            let mut shown = Vec::new();
            for &mode in &self.mode {
                for (station, picture) in studio.pictures(mode, &shots, clock)?.into_iter().enumerate() {
                    let picture = match background {
                        Background::Transparent => picture,
                        Background::Color(color) => picture.over(color),
                    };
                    let name = stations.list[station].0.clone();
                    let legend = studio.legend(mode);
                    let file = file_name(file);
                    shown.push((station, Shown { file, station: name, mode, picture, legend }));
                }
            }
            shown.sort_by_key(|(station, _)| *station);
            Ok(shown.into_iter().map(|(_, shown)| shown).collect())
        })
    }

    fn png(&self, all: Vec<Shown>) -> Result<Vec<u8>, Failure> {
        let places = all.len() / self.files.len() / self.mode.len();
        let row = [self.mode.len(), places, self.files.len()].into_iter().find(|&n| n > 1).unwrap_or(1);
        // What belongs together stays in one line, unless it is all that there is.
        let usual = || if row == all.len() { columns(row) } else { row };
        let columns = self.columns.map_or_else(usual, usize::from);
        let has_captions = self.captions || (all.len() > 1 && !self.no_captions);
        let captions: Vec<String> = all.iter().map(|shown| shown.differences(&all).join("  ")).collect();
        let panel = |(shown, caption): (Shown, String)| match has_captions {
            true => Panel { picture: shown.picture, caption, legend: shown.legend },
            false => Panel { picture: shown.picture, caption: String::new(), legend: None },
        };
        let panels: Vec<Panel> = all.into_iter().zip(captions).map(panel).collect();
        sheet(&panels, columns).to_png().map_err(|e| Failure::new(Exit::Failed, e.to_string()))
    }

    /// One layer for each picture, with alpha; its name says what differs between the pictures.
    fn exr(&self, all: &[Shown]) -> Result<Vec<u8>, Failure> {
        let size = |shown: &Shown| [shown.picture.width, shown.picture.height];
        let first = size(&all[0]);
        if let Some(other) = all.iter().map(size).find(|&other| other != first) {
            let what = format!("layers of {first:?} and of {other:?} pixels do not fit into one EXR");
            return Err(Failure::new(Exit::Usage, what).remedy("give --size WIDTHxHEIGHT"));
        }
        let names: Vec<String> = all.iter().map(|shown| shown.layer(all)).collect();
        let values = all.iter().map(|shown| shown.picture.pixels.iter().flat_map(Vec4::to_array).collect());
        let values: Vec<Vec<f32>> = values.collect();
        let layers = names.iter().zip(&values);
        let layers: Vec<ExrLayer<'_>> =
            layers.map(|(name, values)| ExrLayer { name, channels: 4, values }).collect();
        let mut bytes = Cursor::new(Vec::new());
        write_exr_layers(&mut bytes, first.map(|n| n as u32), ExrDepth::Single, &layers)
            .map_err(|e| Failure::new(Exit::Failed, e.to_string()))?;
        Ok(bytes.into_inner())
    }
}

impl Shown {
    /// What tells this picture from others: of file, station and mode those that differ; the mode at least.
    fn differences(&self, all: &[Self]) -> Vec<String> {
        let mode = self.mode.name();
        let mut words = Vec::new();
        if all.iter().any(|other| other.file != self.file) {
            words.push(self.file.clone());
        }
        if all.iter().any(|other| other.station != self.station) {
            words.push(self.station.clone());
        }
        if words.is_empty() || all.iter().any(|other| other.mode != self.mode) {
            words.push(mode);
        }
        words
    }

    /// Its layer in an EXR: words with dots between them, which themselves have none. A single picture is the image.
    fn layer(&self, all: &[Self]) -> String {
        if all.len() == 1 {
            return String::new();
        }
        let plain = |word: String| -> String {
            word.chars().map(|c| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' }).collect()
        };
        self.differences(all).into_iter().map(plain).collect::<Vec<_>>().join(".")
    }
}
