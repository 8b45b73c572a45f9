//! Everything that light is traced in, read from files: a scene, what stands in its way, and its lights; for a bake, and
//! again for a baked file.

use std::path::Path;

use lightkiln_light::{Lighting, Tracer};
use lightkiln_scene::{ReadOptions, Scene};

use crate::file_light::Recipe;
use crate::lighting::LightOptions;
use crate::moving::MovingParts;
use crate::signals::{Signals, Stage};
use crate::{BakeError, FileLight, Surface};

/// A scene, what stands in the way of its light, and the lights.
pub struct Scenery {
    /// The scene that gets light.
    pub scene: Scene,
    /// Scenes that stand in the way and get none.
    pub occluders: Vec<Scene>,
    /// The lights; a studio's where signals need light and nothing shines.
    pub lighting: Lighting,
    /// Whether they are the studio's.
    pub is_studio: bool,
}

impl Scenery {
    /// Reads all files.
    ///
    /// # Errors
    /// [`BakeError::Scene`] for a file that cannot be read, and those of [`LightOptions::lighting`].
    pub fn read(
        path: &Path,
        scene: Option<usize>,
        signals: &Signals,
        options: &LightOptions,
    ) -> Result<Self, BakeError> {
        Self::around(Scene::read(path, &read_options(scene, signals, options))?, signals, options)
    }

    /// Reads what belongs to a scene that was read as [`Self::read`] does.
    ///
    /// # Errors
    /// As there.
    fn around(scene: Scene, signals: &Signals, options: &LightOptions) -> Result<Self, BakeError> {
        let occluders = options.read_occluders(signals.needs_surfaces())?;
        let lighting = options.lighting(&scene)?;
        let shines = |scene: &Scene| !scene.emissive_triangles().is_empty();
        let is_studio =
            signals.are_paths() && lighting.is_empty() && !shines(&scene) && !occluders.iter().any(shines);
        let lighting = if is_studio { Lighting::studio() } else { lighting };
        Ok(Self { scene, occluders, lighting, is_studio })
    }

    /// The surface that gets light, and what stands in its way; `file` is the name for messages.
    ///
    /// # Errors
    /// As [`LightOptions::cast`] and [`Surface::with`].
    pub fn surface(&self, file: &str, options: &LightOptions) -> Result<Surface<'_>, BakeError> {
        Surface::with(&self.scene, file, options.cast(&self.scene, &self.occluders)?)
    }

    /// What is worth a word.
    ///
    /// - `moving`: what became of the scene's moving parts
    pub fn remarks(&self, moving: &MovingParts) -> Vec<String> {
        let studio = "the scene has no light: a studio is used, a soft dome and a key light (docs/LIGHT.md); give it a \
                      --sun, a --sky or an --environment";
        self.is_studio.then(|| studio.to_owned()).into_iter().chain(moving.remark(&self.scene)).collect()
    }
}

fn read_options(scene: Option<usize>, signals: &Signals, options: &LightOptions) -> ReadOptions {
    options.read_options(scene, signals.needs_surfaces())
}

/// How a file is opened.
#[derive(Clone, Copy, Debug, Default)]
pub struct Opening<'a> {
    /// Which of its scenes; its default scene if none.
    pub scene: Option<usize>,
    /// The surroundings, where they lie elsewhere than the file says.
    pub environment: Option<&'a Path>,
    /// Whether a file that is not baked is an error.
    pub needs_light: bool,
    /// Whether all is read that surfaces look like.
    pub finish: bool,
}

/// A file and what its light is made of: as it says itself if it is baked, by the defaults if it is not.
pub struct Opened {
    /// How its light was made; none if it is not baked.
    pub recipe: Option<Recipe>,
    /// Its signals.
    pub signals: Signals,
    /// Which light there is and what it meets.
    pub options: LightOptions,
    /// The scene and all around it.
    pub scenery: Scenery,
}

impl Opened {
    /// Opens a file.
    ///
    /// # Errors
    /// [`BakeError::NotBaked`], and those of [`Recipe::read`] and [`Scenery::read`].
    pub fn read(path: &Path, opening: Opening<'_>) -> Result<Self, BakeError> {
        let Opening { scene, environment, needs_light, finish } = opening;
        let plain = ReadOptions { scene, ..ReadOptions::default() };
        let read = Scene::read(path, &plain)?;
        let recipe = match FileLight::recipe(&read, &crate::file_name(path)) {
            Ok(recipe) => Some(recipe),
            Err(BakeError::NotBaked { .. }) if !needs_light => None,
            Err(error) => return Err(error),
        };
        let (signals, mut options) = match &recipe {
            Some(recipe) => recipe.read(path.parent().unwrap_or(Path::new("")))?,
            None => Default::default(),
        };
        if let Some(environment) = environment {
            options.environment = Some(environment.to_owned());
        }
        // Only light that meets colors, glass or a variant asks for another look at the file.
        let mut wanted = read_options(scene, &signals, &options);
        wanted.surfaces |= finish;
        wanted.finish = finish;
        let read = if wanted == plain {
            read
        } else {
            drop(read);
            Scene::read(path, &wanted)?
        };
        let scenery = Scenery::around(read, &signals, &options)?;
        Ok(Self { recipe, signals, options, scenery })
    }

    /// What the file's signals are made of; `distance` is where rays of occlusion end.
    pub fn stage<'a>(
        &'a self,
        surface: &'a Surface<'a>,
        tracer: &'a Tracer<'a>,
        distance: f32,
        seed: u64,
    ) -> Stage<'a> {
        let Self { options, scenery, .. } = self;
        Stage { surface, tracer, lighting: &scenery.lighting, options, distance, seed }
    }
}
