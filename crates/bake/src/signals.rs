//! Which signal is baked: the choice by name, and the signal behind it.

use std::path::PathBuf;
use std::str::FromStr;

use glam::Vec3;
use lightkiln_light::{AmbientOcclusion, Disk, Layer, Shadow, Signal, Tracer};
use lightkiln_mesh::SurfacePoint;
use lightkiln_scene::{Slot, Textures};

use crate::options::Plan;
use crate::{BakeError, Surface};

/// What is baked.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum SignalChoice {
    /// Ambient occlusion, traced.
    #[default]
    AmbientOcclusion,
    /// The occlusion textures of the materials.
    Occlusion,
    /// The lightmap textures of the materials.
    Lightmap,
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
pub const SIGNALS: &str = "  ao               ambient occlusion, traced
  occlusion        what the occlusion textures of the file show
  lightmap         what its lightmaps show (MOZ_lightmap, EXT_lightmap)
  lightmap:FILE    an image on the second set of texture coordinates
  texture:FILE     an image on the first set
  base-color       what the base color textures show
  shadow:X,Y,Z[,R] the shadow of a disk of radius R at a point, facing the scene";

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
            ("lightmap", None) => Ok(Self::Lightmap),
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

impl SignalChoice {
    /// The signal on a surface.
    ///
    /// # Errors
    /// [`BakeError::NoSignal`] for what the scene does not have, [`BakeError::Scene`] for images that are broken.
    pub fn on<'a>(
        &self,
        surface: &'a Surface<'a>,
        tracer: &'a Tracer<'a>,
        plan: &Plan,
    ) -> Result<Box<dyn Signal + 'a>, BakeError> {
        let shown = |textures: Option<Textures<'a>>, what: &str| -> Result<Box<dyn Signal + 'a>, BakeError> {
            let textures = textures.ok_or_else(|| BakeError::NoSignal { what: what.to_owned() })?;
            let layer = Layer { channels: textures.channels(), ..Layer::scalar(what) };
            Ok(Box::new(Shown { surface, textures, layers: [layer] }))
        };
        let scene = surface.scene;
        match self {
            Self::AmbientOcclusion => {
                Ok(Box::new(AmbientOcclusion::new(tracer, &surface.mesh, plan.ao_distance, plan.seed)))
            }
            Self::Occlusion => shown(scene.textures(Slot::Occlusion)?, "occlusion texture"),
            Self::Lightmap => shown(scene.textures(Slot::Lightmap)?, "lightmap texture"),
            Self::BaseColor => shown(scene.textures(Slot::BaseColor)?, "base color texture"),
            Self::Image { file, set } => {
                shown(scene.textured_with(file, *set)?, &format!("primitive with TEXCOORD_{set}"))
            }
            &Self::Shadow { centre, radius } => {
                let (low, high) = surface.mesh.bounds();
                let disk = Disk { centre, axis: (low + high) * 0.5 - centre, radius };
                Ok(Box::new(Shadow::new(tracer, &surface.mesh, disk, plan.seed)))
            }
        }
    }

    /// The signal with one channel, as codes hold it: colors become their luminance (Rec. ITU-R BT.709).
    ///
    /// # Errors
    /// As [`Self::on`].
    pub fn on_one_channel<'a>(
        &self,
        surface: &'a Surface<'a>,
        tracer: &'a Tracer<'a>,
        plan: &Plan,
    ) -> Result<Box<dyn Signal + 'a>, BakeError> {
        let signal = self.on(surface, tracer, plan)?;
        Ok(if signal.channels() == 3 {
            Box::new(Luminance(signal, [Layer::scalar("luminance")]))
        } else {
            signal
        })
    }

    /// Whether the signal is traced by rays. What is not has no noise.
    pub fn is_traced(&self) -> bool {
        matches!(self, Self::AmbientOcclusion | Self::Shadow { .. })
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

/// The luminance of a signal of three channels.
struct Luminance<'a>(Box<dyn Signal + 'a>, [Layer; 1]);

impl Signal for Luminance<'_> {
    fn layers(&self) -> &[Layer] {
        &self.1
    }

    fn rays_per_batch(&self) -> u32 {
        self.0.rays_per_batch()
    }

    fn batch(&self, point: SurfacePoint, key: u64, batch: u32, out: &mut [f32]) -> f32 {
        let mut color = [0.0; 3];
        let back = self.0.batch(point, key, batch, &mut color);
        out[0] = Vec3::from(color).dot(Vec3::new(0.2126, 0.7152, 0.0722));
        back
    }
}

#[cfg(test)]
mod tests {
    use lightkiln_mesh::TriangleId;
    use lightkiln_scene::{ReadOptions, Scene};

    use super::*;
    use crate::options::BakeOptions;

    #[test]
    fn signal_of_one_channel_is_the_luminance() {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data/fence.glb");
        let scene = Scene::read(&path, &ReadOptions::default()).unwrap();
        let surface = Surface::new(&scene, "fence.glb").unwrap();
        let plan = Plan::new(&BakeOptions::default(), &surface.mesh).unwrap();
        let tracer = Tracer::new(&surface.mesh, &surface).unwrap();
        let choice = SignalChoice::BaseColor;
        let color = choice.on(&surface, &tracer, &plan).unwrap();
        let one = choice.on_one_channel(&surface, &tracer, &plan).unwrap();
        assert_eq!((color.channels(), one.channels()), (3, 1));
        for triangle in surface.mesh.triangle_ids().step_by(97).chain([TriangleId(0)]) {
            let point = SurfacePoint { triangle, barycentric: [0.3, 0.4] };
            let (mut rgb, mut y) = ([0.0; 3], [0.0]);
            color.batch(point, 1, 0, &mut rgb);
            one.batch(point, 1, 0, &mut y);
            assert!((0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2] - y[0]).abs() < 1e-6);
        }
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
