//! Whether a point lies inside other geometry, by what a batch of rays meets first.
//!
//! Samples of a floor under the leg of a chair, or of a wall inside another, see nothing but backs. Their light is
//! never shown and must not be fitted; every traced signal counts backs in its batch 0, and
//! [`crate::Estimates::valid`] draws the line.

use glam::Vec3;
use lightkiln_mesh::random;

use crate::directions::{BATCH, cosine_hemisphere, frame, net};
use crate::{Hit, Origin, Tracer};

/// All but this share of the rays meet backs, and none but this share of the light arrives, in closed parts.
const ENCLOSED: f32 = 0.97;
const DARK: f32 = 0.03;

/// Counts the opaque backs among first hits.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Backs {
    all: u32,
    single_sided: u32,
}

impl Backs {
    /// Looks at the first hit of a ray, at any distance. What is translucent is passed over.
    pub(crate) fn see(&mut self, tracer: &Tracer<'_>, hit: &Hit) {
        let flags = tracer.surfaces().flags(hit.triangle);
        let back = !flags.translucent && hit.back != flags.turned;
        self.all += u32::from(back);
        self.single_sided += u32::from(back && !flags.double_sided);
    }

    /// The share of backs that speaks for being inside, `0..=1`.
    ///
    /// Backs of double-sided triangles count only where nearly all that is seen are backs and nearly no light
    /// arrives: exporters mark closed parts as double-sided, and a point inside such a part is in the dark; a room
    /// of single walls that face outward is not.
    ///
    /// - `rays`: how many looked
    /// - `light`: the share of light that arrives
    pub(crate) fn share(self, rays: usize, light: f32) -> f32 {
        let rays = rays as f32;
        if self.all as f32 >= ENCLOSED * rays && light <= DARK {
            return 1.0;
        }
        self.single_sided as f32 / rays
    }
}

/// Rays of one batch about a normal, for signals whose own rays do not look around.
///
/// - `light`: the share of light that arrives by the signal itself
/// - returns the share of backs that speaks for being inside, `0..=1`: what [`crate::Signal::batch`] gives
pub fn back_share(tracer: &Tracer<'_>, origin: Origin, normal: Vec3, key: u64, light: f32) -> f32 {
    let [x, y] = frame(normal);
    let directions = net(random::hash(0, key, 0, 0xb5)).map(|square| {
        let local = cosine_hemisphere(square);
        x * local.x + y * local.y + normal * local.z
    });
    let mut hits = [None; BATCH];
    tracer.first_hits(origin, &directions, f32::INFINITY, &mut hits);
    let mut backs = Backs::default();
    hits.iter().flatten().for_each(|hit| backs.see(tracer, hit));
    backs.share(BATCH, light)
}
