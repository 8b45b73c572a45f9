//! Which signals are baked: the choice by name, and the signal behind it.
//!
//! Choices that can share rays do: occlusion with bent normals, and everything that paths of light bring.

use std::path::PathBuf;
use std::str::FromStr;

use glam::Vec3;
use lightkiln_light::{
    AmbientOcclusion, BentNormal, Combined, Disk, Layer, Lighting, Output, PathOptions, PathTraced, Shadow,
    Shadows, Signal, Tracer,
};
use lightkiln_mesh::SurfacePoint;
use lightkiln_scene::{Slot, Textures};

use crate::authored::TimesAuthored;
use crate::harmonics::Judged;
use crate::lighting::{AuthoredOcclusion, DEFAULT_BOUNCES, LightOptions};
use crate::{BakeError, Surface};

/// What is baked.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum SignalChoice {
    /// Ambient occlusion, traced.
    #[default]
    AmbientOcclusion,
    /// The mean open direction, traced.
    BentNormal,
    /// How much of each light is seen, traced.
    Shadows,
    /// Light that comes straight, traced.
    Direct,
    /// Light by way of other surfaces, traced.
    Indirect,
    /// All light, traced.
    Irradiance,
    /// All light as a function of the normal, traced: spherical harmonics up to this order, 1 or 2.
    Harmonics(usize),
    /// The occlusion textures of the materials.
    Occlusion,
    /// The lightmap textures of the materials.
    FileLightmap,
    /// The base colors of the materials.
    BaseColor,
    /// An image file on a set of the scene's texture coordinates.
    Image {
        /// PNG, JPEG or WebP.
        file: PathBuf,
        /// The number of the set.
        set: u32,
    },
    /// The shadow of a disk that faces the middle of the scene.
    Shadow {
        /// The middle of the disk.
        centre: Vec3,
        /// Its radius.
        radius: f32,
    },
}

/// What [`SignalChoice`] reads, for help texts.
pub const SIGNALS: &str = "  ao               ambient occlusion: the open share of the hemisphere
  bent-normal      the mean open direction
  shadow           how much of each light is seen
  direct           light straight from lights, sky and shining surfaces, in lux
  indirect         light by way of other surfaces, in lux
  lightmap         both: irradiance, in lux
  sh1, sh2         the same for any normal: spherical harmonics, 4 or 9 RGB coefficients
  occlusion        what the occlusion textures of the file show
  file-lightmap    what its lightmaps show (MOZ_lightmap, EXT_lightmap)
  lightmap:FILE    an image on the second set of texture coordinates
  texture:FILE     an image on the first set
  base-color       what the base color textures show
  shadow:X,Y,Z[,R] the shadow of a disk of radius R at a point, facing the scene";

/// Signals of one bake, one layer or more each. Written with `+` between them.
#[derive(Clone, Debug, PartialEq)]
pub struct Signals(pub Vec<SignalChoice>);

impl Default for Signals {
    fn default() -> Self {
        Self(vec![SignalChoice::default()])
    }
}

impl FromStr for Signals {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let choices: Vec<SignalChoice> = text.split('+').map(str::parse).collect::<Result<_, _>>()?;
        match choices.iter().enumerate().find(|(i, choice)| choices[..*i].contains(choice)) {
            Some((_, twice)) => Err(format!("{twice} is named twice")),
            None => Ok(Self(choices)),
        }
    }
}

impl std::fmt::Display for Signals {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (number, choice) in self.0.iter().enumerate() {
            write!(f, "{}{choice}", if number > 0 { "+" } else { "" })?;
        }
        Ok(())
    }
}

impl std::fmt::Display for SignalChoice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::AmbientOcclusion => f.write_str("ao"),
            Self::BentNormal => f.write_str("bent-normal"),
            Self::Shadows => f.write_str("shadow"),
            Self::Direct => f.write_str("direct"),
            Self::Indirect => f.write_str("indirect"),
            Self::Irradiance => f.write_str("lightmap"),
            Self::Harmonics(order) => write!(f, "sh{order}"),
            Self::Occlusion => f.write_str("occlusion"),
            Self::FileLightmap => f.write_str("file-lightmap"),
            Self::BaseColor => f.write_str("base-color"),
            Self::Image { file, set: 0 } => write!(f, "texture:{}", file.display()),
            Self::Image { file, .. } => write!(f, "lightmap:{}", file.display()),
            Self::Shadow { centre: c, radius } => write!(f, "shadow:{},{},{},{radius}", c.x, c.y, c.z),
        }
    }
}

impl FromStr for SignalChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, argument) = text.split_once(':').map_or((text, None), |(n, a)| (n, Some(a)));
        let image = |set| {
            let file = argument
                .filter(|a| !a.is_empty())
                .ok_or_else(|| format!("{name} needs a file: {name}:FILE"))?;
            Ok(Self::Image { file: file.into(), set })
        };
        match (name, argument) {
            ("ao", None) => Ok(Self::AmbientOcclusion),
            ("occlusion", None) => Ok(Self::Occlusion),
            ("bent-normal", None) => Ok(Self::BentNormal),
            ("shadow", None) => Ok(Self::Shadows),
            ("direct", None) => Ok(Self::Direct),
            ("indirect", None) => Ok(Self::Indirect),
            ("lightmap" | "irradiance", None) => Ok(Self::Irradiance),
            ("sh1", None) => Ok(Self::Harmonics(1)),
            ("sh2", None) => Ok(Self::Harmonics(2)),
            ("file-lightmap", None) => Ok(Self::FileLightmap),
            ("base-color", None) => Ok(Self::BaseColor),
            ("texture", _) => image(0),
            ("lightmap", _) => image(1),
            ("shadow", Some(numbers)) => {
                let numbers: Vec<f32> = numbers
                    .split(',')
                    .map(|n| n.trim().parse::<f32>().ok().filter(|n| n.is_finite()))
                    .collect::<Option<_>>()
                    .ok_or_else(|| format!("{numbers:?} are no numbers"))?;
                match numbers[..] {
                    [x, y, z] => Ok(Self::Shadow { centre: Vec3::new(x, y, z), radius: 0.0 }),
                    [x, y, z, radius] if radius >= 0.0 => {
                        Ok(Self::Shadow { centre: Vec3::new(x, y, z), radius })
                    }
                    _ => {
                        Err("a shadow needs a point and perhaps a radius: shadow:X,Y,Z or shadow:X,Y,Z,R"
                            .into())
                    }
                }
            }
            _ => Err(format!("{text:?} is no signal; there are\n{SIGNALS}")),
        }
    }
}

/// The layer that shows the occlusion textures themselves.
pub(crate) const OCCLUSION_NAME: &str = "occlusion";

/// What signals are made of.
pub struct Stage<'a> {
    /// The surface that gets light.
    pub surface: &'a Surface<'a>,
    /// Rays.
    pub tracer: &'a Tracer<'a>,
    /// The lights; only paths of light and shadows have use of them.
    pub lighting: &'a Lighting,
    /// Options of the light.
    pub options: &'a LightOptions,
    /// Where rays of occlusion end.
    pub distance: f32,
    /// Seed of the rays.
    pub seed: u64,
}

impl Signals {
    /// The signal of all layers.
    ///
    /// # Errors
    /// [`BakeError::NoSignal`] for what the scene does not have, [`BakeError::Scene`] for images that are broken,
    /// [`BakeError::Light`] for lights that make no sense.
    pub fn on<'a>(&self, stage: &Stage<'a>) -> Result<Box<dyn Signal + 'a>, BakeError> {
        let signal = self.alone_on(stage)?;
        if stage.options.authored_occlusion.is_some_and(AuthoredOcclusion::is_multiplied) {
            return TimesAuthored::on(signal, stage.surface);
        }
        Ok(signal)
    }

    /// The same without the occlusion textures of the file.
    fn alone_on<'a>(&self, stage: &Stage<'a>) -> Result<Box<dyn Signal + 'a>, BakeError> {
        let mut parts = Vec::new();
        let mut rest = &self.0[..];
        while let Some(first) = rest.first() {
            let paths = rest.iter().take_while(|choice| choice.output().is_some()).count();
            let taken = match rest {
                [SignalChoice::AmbientOcclusion, SignalChoice::BentNormal, ..] => {
                    let options = stage.options.occlusion(stage.distance);
                    let mesh = stage.surface.world();
                    parts.push(Box::new(BentNormal::with_occlusion(stage.tracer, mesh, options, stage.seed))
                        as Box<dyn Signal + 'a>);
                    2
                }
                _ if paths > 0 => {
                    parts.push(stage.paths(&rest[..paths])?);
                    paths
                }
                _ => {
                    parts.push(first.on(stage)?);
                    1
                }
            };
            rest = &rest[taken..];
        }
        Ok(if parts.len() == 1 { parts.remove(0) } else { Box::new(Combined::new(parts)) })
    }

    /// The same, with what their errors are judged by behind their layers ([`Judged`]).
    ///
    /// # Errors
    /// As [`Self::on`].
    pub fn judged_on<'a>(&self, stage: &Stage<'a>) -> Result<Box<dyn Signal + 'a>, BakeError> {
        Ok(Judged::on(self.on(stage)?, stage.surface))
    }

    /// The same without the occlusion textures of the file.
    ///
    /// # Errors
    /// As [`Self::on`].
    pub fn unmultiplied_on<'a>(&self, stage: &Stage<'a>) -> Result<Box<dyn Signal + 'a>, BakeError> {
        Ok(Judged::on(self.alone_on(stage)?, stage.surface))
    }

    /// Whether any of them is traced by rays. What is not has no noise.
    pub fn is_traced(&self) -> bool {
        self.0.iter().any(SignalChoice::is_traced)
    }

    /// Whether any of them has a layer of one channel, which materials can show as occlusion.
    pub fn has_scalar(&self) -> bool {
        let is_scalar = |choice: &SignalChoice| {
            use SignalChoice::{AmbientOcclusion, Occlusion, Shadow, Shadows};
            matches!(choice, AmbientOcclusion | Shadows | Occlusion | Shadow { .. })
        };
        self.0.iter().any(is_scalar)
    }

    /// Whether any of them needs the colors of surfaces.
    pub fn needs_surfaces(&self) -> bool {
        self.are_paths() || self.0.contains(&SignalChoice::Shadows)
    }

    /// Whether any of them is made of paths of light.
    pub fn are_paths(&self) -> bool {
        self.0.iter().any(|choice| choice.output().is_some())
    }

    /// The textures of the file that the signals take the place of.
    pub fn replaced(&self) -> Vec<Slot> {
        let slot = |choice: &SignalChoice| match choice {
            SignalChoice::Occlusion => Some(Slot::Occlusion),
            SignalChoice::FileLightmap => Some(Slot::Lightmap),
            _ => None,
        };
        self.0.iter().filter_map(slot).collect()
    }

    /// The same signals with file names changed.
    #[must_use]
    pub fn map_files(&self, map: impl Fn(&std::path::Path) -> PathBuf) -> Self {
        let choice = |choice: &SignalChoice| match choice {
            SignalChoice::Image { file, set } => SignalChoice::Image { file: map(file), set: *set },
            other => other.clone(),
        };
        Self(self.0.iter().map(choice).collect())
    }

    /// Every file that these signals name.
    pub fn files(&self) -> impl Iterator<Item = &PathBuf> {
        self.0.iter().filter_map(|choice| match choice {
            SignalChoice::Image { file, .. } => Some(file),
            _ => None,
        })
    }
}

impl<'a> Stage<'a> {
    fn paths(&self, choices: &[SignalChoice]) -> Result<Box<dyn Signal + 'a>, BakeError> {
        let outputs: Vec<Output> = choices.iter().filter_map(SignalChoice::output).collect();
        let bounces = self.options.bounces.unwrap_or(DEFAULT_BOUNCES);
        let options = PathOptions { bounces, seed: self.seed, ..PathOptions::default() };
        let traced = PathTraced::new(self.tracer, self.surface.world(), self.lighting, &outputs, options)?;
        if !traced.has_light() {
            return Err(BakeError::NoSignal { what: "light".into() });
        }
        Ok(Box::new(traced))
    }
}

impl SignalChoice {
    fn output(&self) -> Option<Output> {
        match self {
            Self::Direct => Some(Output::Direct),
            Self::Indirect => Some(Output::Indirect),
            Self::Irradiance => Some(Output::Irradiance),
            Self::Harmonics(order) => Some(Output::Harmonics { bands: order + 1 }),
            _ => None,
        }
    }

    /// The signal on a surface.
    ///
    /// # Errors
    /// As [`Signals::on`].
    pub fn on<'a>(&self, stage: &Stage<'a>) -> Result<Box<dyn Signal + 'a>, BakeError> {
        let surface = stage.surface;
        let shown = |textures: Option<Textures<'a>>,
                     name: &str,
                     what: &str|
         -> Result<Box<dyn Signal + 'a>, BakeError> {
            let textures = textures.ok_or_else(|| BakeError::NoSignal { what: what.to_owned() })?;
            let layer = Layer { channels: textures.channels(), ..Layer::scalar(name) };
            Ok(Box::new(Shown { surface, textures, layers: [layer] }))
        };
        let (scene, mesh) = (surface.scene, surface.world());
        let occlusion = stage.options.occlusion(stage.distance);
        match self {
            Self::AmbientOcclusion => {
                Ok(Box::new(AmbientOcclusion::with_options(stage.tracer, mesh, occlusion, stage.seed)))
            }
            Self::BentNormal => Ok(Box::new(BentNormal::new(stage.tracer, mesh, occlusion, stage.seed))),
            Self::Shadows => {
                if stage.lighting.lights.is_empty() {
                    return Err(BakeError::NoSignal {
                        what: "light that casts a shadow: give it a --sun".into(),
                    });
                }
                Ok(Box::new(Shadows::new(stage.tracer, mesh, &stage.lighting.lights, stage.seed)?))
            }
            Self::Direct | Self::Indirect | Self::Irradiance | Self::Harmonics(_) => {
                stage.paths(std::slice::from_ref(self))
            }
            Self::Occlusion => shown(scene.textures(Slot::Occlusion)?, OCCLUSION_NAME, "occlusion texture"),
            Self::FileLightmap => shown(scene.textures(Slot::Lightmap)?, "lightmap", "lightmap texture"),
            Self::BaseColor => shown(scene.textures(Slot::BaseColor)?, "baseColor", "base color texture"),
            Self::Image { file, set } => {
                let name = if *set == 0 { "texture" } else { "lightmap" };
                shown(scene.textured_with(file, *set)?, name, &format!("primitive with TEXCOORD_{set}"))
            }
            &Self::Shadow { centre, radius } => {
                let (low, high) = surface.mesh.bounds();
                let disk = Disk { centre, axis: (low + high) * 0.5 - centre, radius };
                Ok(Box::new(Shadow::new(stage.tracer, mesh, disk, stage.seed)))
            }
        }
    }

    /// Whether the signal is traced by rays. What is not has no noise.
    pub fn is_traced(&self) -> bool {
        !matches!(self, Self::Occlusion | Self::FileLightmap | Self::BaseColor | Self::Image { .. })
    }
}

/// Textures as a signal. Points that show nothing count as hidden.
struct Shown<'a> {
    surface: &'a Surface<'a>,
    textures: Textures<'a>,
    layers: [Layer; 1],
}

impl Signal for Shown<'_> {
    fn layers(&self) -> &[Layer] {
        &self.layers
    }

    /// One look says all there is: as much as very many rays.
    fn rays_per_batch(&self) -> u32 {
        1 << 24
    }

    fn batch(&self, point: SurfacePoint, _: u64, _: u32, out: &mut [f32]) -> f32 {
        let (part, triangle) = self.surface.part_of(point.triangle);
        if self.textures.sample(part, triangle, point.barycentric, out) {
            return 0.0;
        }
        out.fill(0.0);
        1.0
    }
}

#[cfg(test)]
mod tests {
    use lightkiln_scene::{ReadOptions, Scene};

    use super::*;

    #[test]
    fn signal_of_a_texture_has_its_channels() {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data/fence.glb");
        let scene = Scene::read(&path, &ReadOptions::default()).unwrap();
        let surface = Surface::new(&scene, "fence.glb").unwrap();
        let tracer = Tracer::new(&surface.mesh, &surface).unwrap();
        let (lighting, options) = (Lighting::default(), LightOptions::default());
        let stage = Stage {
            surface: &surface,
            tracer: &tracer,
            lighting: &lighting,
            options: &options,
            distance: 1.0,
            seed: 0,
        };
        let layers = |text: &str| {
            let signals: Signals = text.parse().unwrap();
            let signal = signals.on(&stage).unwrap();
            signal.layers().iter().map(|l| (l.name.clone(), l.channels)).collect::<Vec<_>>()
        };
        assert_eq!(layers("base-color"), [("baseColor".to_owned(), 3)]);
        let both = [("ambientOcclusion".to_owned(), 1), ("bentNormal".to_owned(), 3)];
        assert_eq!(layers("ao+bent-normal"), both);
        assert_eq!(layers("base-color+ao")[1], both[0]);
        assert!(Signals(vec![SignalChoice::Shadows]).on(&stage).is_err());
    }

    #[test]
    fn signals_are_written_as_they_are_read() {
        for text in
            ["ao", "ao+bent-normal+lightmap", "sh2", "file-lightmap", "texture:a.png+shadow:1,2,3,0.5"]
        {
            assert_eq!(text.parse::<Signals>().unwrap().to_string(), text);
        }
        assert!("ao+ao".parse::<Signals>().is_err() && "".parse::<Signals>().is_err());
    }

    #[test]
    fn choice_reads_every_name() {
        let read = |text: &str| text.parse::<SignalChoice>();
        assert_eq!(read("ao"), Ok(SignalChoice::AmbientOcclusion));
        assert_eq!(read("texture:a b.png"), Ok(SignalChoice::Image { file: "a b.png".into(), set: 0 }));
        assert_eq!(read("lightmap:C:x.png"), Ok(SignalChoice::Image { file: "C:x.png".into(), set: 1 }));
        let shadow = SignalChoice::Shadow { centre: Vec3::new(-1.0, 2.0, 0.5), radius: 0.25 };
        assert_eq!(read("shadow:-1,2,0.5,0.25"), Ok(shadow));
        for wrong in
            ["", "ao:", "texture", "texture:", "shadow:1,2", "shadow:1,2,x", "shadow:1,2,3,-1", "light"]
        {
            assert!(read(wrong).is_err(), "{wrong}");
        }
    }
}
