//! Rays against a mesh: what they meet first, and how much of them comes through.
//!
//! The tracer works in normalized coordinates: the middle of the scene's bounds is moved to zero in double
//! precision and the scene is scaled by a power of two to an extent of about 1. Scenes in millimetres and in
//! kilometres run through the same numbers, and a power of two between two scenes makes no difference at all.

use glam::{DVec3, Vec3};
use lightkiln_mesh::{Mesh, TriangleId};

use crate::lanes::{self, Lanes, Path, WIDTH};
use crate::traverse::{BUNDLE, Bundle, Visitor, Walk};
use crate::tree::{Block, NO_TRIANGLE, Tree};
use crate::{LightError, Origin};

/// What a triangle is to a ray.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SurfaceFlags {
    /// A ray may go on behind it, weakened by [`Surfaces::opacity`].
    pub translucent: bool,
    /// Its back is as good as its front: seeing it does not by itself mean to be inside.
    pub double_sided: bool,
    /// Its back is the side that is seen: light is wanted there, and its front is what faces the inside.
    pub turned: bool,
}

/// What a tracer asks about the surfaces of a mesh.
pub trait Surfaces: Sync {
    /// What a triangle is to a ray; asked once when the tracer is built (for
    /// `translucent`), and again wherever the sides matter, so that these may be decided with the tracer's help.
    fn flags(&self, triangle: TriangleId) -> SurfaceFlags;
    /// The share of a ray that ends at a point, in `0..=1`. Asked only where the flags say translucent.
    ///
    /// - `barycentric`: weights of the second and third corner
    fn opacity(&self, triangle: TriangleId, barycentric: [f32; 2]) -> f32;
    /// The share of light that a point reflects diffusely, for red, green and blue, in `0.0..=0.95` (more is cut
    /// off); of a translucent surface, the share of the light that [`Self::opacity`] keeps. A middle grey if not
    /// told otherwise.
    fn albedo(&self, triangle: TriangleId, barycentric: [f32; 2]) -> Vec3 {
        let _ = (triangle, barycentric);
        Vec3::splat(0.5)
    }
    /// The radiance with which a point shines by itself, cd/m2, in all directions of its front, and of its back where
    /// it is double-sided. None if not told otherwise.
    fn emission(&self, triangle: TriangleId, barycentric: [f32; 2]) -> Vec3 {
        let _ = (triangle, barycentric);
        Vec3::ZERO
    }
    /// The share of light that goes straight on behind a point, for red, green and blue, in `0..=1`. Asked only where
    /// the flags say translucent; `1 - opacity` if not told otherwise.
    fn transmission(&self, triangle: TriangleId, barycentric: [f32; 2]) -> Vec3 {
        Vec3::splat(1.0 - self.opacity(triangle, barycentric))
    }
}

/// Every triangle opaque and single-sided.
#[derive(Clone, Copy, Debug, Default)]
pub struct Opaque;

impl Surfaces for Opaque {
    fn flags(&self, _: TriangleId) -> SurfaceFlags {
        SurfaceFlags::default()
    }
    fn opacity(&self, _: TriangleId, _: [f32; 2]) -> f32 {
        1.0
    }
}

/// Where a ray meets the mesh first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// The triangle; of several at the same distance the one with the lowest number.
    pub triangle: TriangleId,
    /// Weights of its second and third corner.
    pub barycentric: [f32; 2],
    /// Distance in lengths of the direction vector.
    pub distance: f32,
    /// The ray came from behind the triangle.
    pub back: bool,
}

/// A mesh made ready for rays.
pub struct Tracer<'a> {
    surfaces: &'a dyn Surfaces,
    tree: Tree,
    centre: DVec3,
    scale: f64,
    path: Path,
}

impl<'a> Tracer<'a> {
    /// Builds the tree. Degenerate triangles are left out: no ray meets them.
    ///
    /// # Errors
    /// [`LightError::TooLarge`] for more triangles than the tree can number.
    pub fn new(mesh: &Mesh, surfaces: &'a dyn Surfaces) -> Result<Self, LightError> {
        let count = mesh.triangle_count();
        if count >= (1 << 30) {
            return Err(LightError::TooLarge { triangles: count });
        }
        let (low, high) = mesh.bounds();
        let (low, high) = (low.as_dvec3(), high.as_dvec3());
        let centre = (low + high) * 0.5;
        let extent = (high - low).max_element();
        let scale = if extent > 0.0 { (-extent.log2().ceil()).exp2() } else { 1.0 };
        let mut tracer = Self {
            surfaces,
            tree: Tree { nodes: Vec::new(), blocks: Vec::new(), root: crate::tree::NONE },
            centre,
            scale,
            path: Path::detect(),
        };
        let corners = |t: u32| mesh.corners(TriangleId(t)).map(|p| tracer.normalize(p));
        tracer.tree = Tree::new(count, corners, |t| surfaces.flags(TriangleId(t)).translucent);
        Ok(tracer)
    }

    /// The same tracer on the portable path, whatever the processor has. Results are the same bit for bit;
    /// this is for tests and measurements.
    #[must_use]
    pub fn portable(mut self) -> Self {
        self.path = Path::Portable;
        self
    }

    /// What the surfaces are.
    pub fn surfaces(&self) -> &dyn Surfaces {
        self.surfaces
    }

    /// Bytes held by the tree.
    pub fn bytes(&self) -> usize {
        size_of_val(self.tree.nodes.as_slice()) + size_of_val(self.tree.blocks.as_slice())
    }

    /// A world position in normalized coordinates.
    #[inline]
    pub(crate) fn normalize(&self, position: Vec3) -> Vec3 {
        ((position.as_dvec3() - self.centre) * self.scale).as_vec3()
    }

    /// A world distance in normalized units, at most the largest finite number.
    #[inline]
    fn normalize_distance(&self, distance: f32) -> f32 {
        ((f64::from(distance) * self.scale) as f32).min(f32::MAX)
    }

    /// A ray's start anywhere in space, as it is; [`Origin::on_surface`] makes one that lies on the mesh.
    pub fn origin_at(&self, position: Vec3) -> Origin {
        Origin { position: self.normalize(position) }
    }

    /// What a ray meets first.
    ///
    /// - `origin`: world position, taken as it is (see [`Self::first_hits`] for rays from the mesh)
    /// - `direction`: of any length but zero; distances count in its lengths
    /// - `max_distance`: hits beyond it are not seen; may be infinite
    pub fn closest(&self, origin: Vec3, direction: Vec3, max_distance: f32) -> Option<Hit> {
        let mut hits = [None];
        self.first_hits(self.origin_at(origin), &[direction], max_distance, &mut hits);
        hits[0]
    }

    /// What each of many rays from one point meets first. Faster than one by one.
    ///
    /// `hits` is as long as `directions`.
    pub fn first_hits(
        &self,
        origin: Origin,
        directions: &[Vec3],
        max_distance: f32,
        hits: &mut [Option<Hit>],
    ) {
        let limit = self.normalize_distance(max_distance);
        for (directions, hits) in directions.chunks(BUNDLE).zip(hits.chunks_mut(BUNDLE)) {
            let (mut bundle, lengths) = bundle_of(origin, directions, limit);
            let mut visitor = Closest { hits: [None; BUNDLE] };
            let walk = Walk { tree: &self.tree, bundle: &mut bundle, visitor: &mut visitor };
            lanes::dispatch(self.path, walk);
            hits.copy_from_slice(&visitor.hits[..hits.len()]);
            for (hit, length) in hits.iter_mut().zip(lengths) {
                if let Some(hit) = hit {
                    hit.distance = (f64::from(hit.distance) / self.scale) as f32 / length;
                }
            }
        }
    }

    /// How much of each of many rays from one point comes through: 1 where nothing is in the way, 0 behind
    /// an opaque triangle, the product of `1 - opacity` behind translucent ones.
    ///
    /// `through` is as long as `directions`.
    pub fn transmittances(
        &self,
        origin: Origin,
        directions: &[Vec3],
        max_distance: f32,
        through: &mut [f32],
    ) {
        let limit = self.normalize_distance(max_distance);
        for (directions, through) in directions.chunks(BUNDLE).zip(through.chunks_mut(BUNDLE)) {
            let (mut bundle, _) = bundle_of(origin, directions, limit);
            let mut visitor = Through { surfaces: self.surfaces, through: [1.0; BUNDLE] };
            let walk = Walk { tree: &self.tree, bundle: &mut bundle, visitor: &mut visitor };
            lanes::dispatch(self.path, walk);
            through.copy_from_slice(&visitor.through[..through.len()]);
        }
    }
}

impl Tracer<'_> {
    /// As [`Self::transmittances`], in red, green and blue: the product of the [`Surfaces::transmission`] of what is
    /// in the way.
    ///
    /// - `directions`: of unit length
    /// - `limits`: how far each ray looks, in the tracer's coordinates
    pub(crate) fn tints(&self, origin: Origin, directions: &[Vec3], limits: &[f32], tints: &mut [Vec3]) {
        let rays = directions.chunks(BUNDLE).zip(limits.chunks(BUNDLE));
        for ((directions, limits), tints) in rays.zip(tints.chunks_mut(BUNDLE)) {
            let mut bundle = Bundle::new(origin.position.to_array());
            for (direction, &limit) in directions.iter().zip(limits) {
                bundle.push(direction.to_array(), limit);
            }
            let mut visitor = Tinted { surfaces: self.surfaces, tints: [Vec3::ONE; BUNDLE] };
            let walk = Walk { tree: &self.tree, bundle: &mut bundle, visitor: &mut visitor };
            lanes::dispatch(self.path, walk);
            tints.copy_from_slice(&visitor.tints[..tints.len()]);
        }
    }

    /// The tracer's units in one unit of the world.
    pub(crate) fn scale(&self) -> f32 {
        self.scale as f32
    }
}

/// A bundle of unit directions, and the lengths that the given ones had.
///
/// The walk's error bounds hold for unit directions. Those that are so within a thousandth stay as they are.
fn bundle_of(origin: Origin, directions: &[Vec3], limit: f32) -> (Bundle, [f32; BUNDLE]) {
    let mut bundle = Bundle::new(origin.position.to_array());
    let mut lengths = [1.0; BUNDLE];
    for (&direction, length) in directions.iter().zip(&mut lengths) {
        if (direction.length_squared() - 1.0).abs() <= 1e-3 {
            bundle.push(direction.to_array(), limit);
        } else {
            *length = direction.as_dvec3().length() as f32;
            let unit = direction.as_dvec3().normalize_or_zero().as_vec3();
            bundle.push(unit.to_array(), (limit * *length).min(f32::MAX));
        }
    }
    (bundle, lengths)
}

/// Weights of the second and third corner from the three edge planes.
fn barycentric(edges: [[f32; WIDTH]; 3], lane: usize) -> [f32; 2] {
    let [a, b, c] = edges.map(|edge| edge[lane]);
    let sum = a + b + c;
    if sum == 0.0 {
        return [1.0 / 3.0; 2];
    }
    let u = (b / sum).clamp(0.0, 1.0);
    [u, (c / sum).clamp(0.0, 1.0 - u)]
}

struct Closest {
    /// With distances in normalized units.
    hits: [Option<Hit>; BUNDLE],
}

impl Visitor for Closest {
    #[inline(always)]
    fn meet<L: Lanes>(
        &mut self,
        ray: usize,
        limit: f32,
        block: &Block,
        lanes: u32,
        t: L,
        edges: [L; 3],
    ) -> f32 {
        let (t, edges) = (t.store(), edges.map(L::store));
        let mut best = (limit, self.hits[ray].map_or(NO_TRIANGLE, |hit| hit.triangle.0));
        let mut rest = lanes;
        let mut winner = None;
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            let candidate = (t[lane], block.triangles[lane]);
            if candidate < best {
                best = candidate;
                winner = Some(lane);
            }
        }
        if let Some(lane) = winner {
            // All three edges have the sign of the ray against the normal.
            let side = edges[0][lane] + edges[1][lane] + edges[2][lane];
            self.hits[ray] = Some(Hit {
                triangle: TriangleId(block.triangles[lane]),
                barycentric: barycentric(edges, lane),
                distance: t[lane],
                back: side > 0.0,
            });
        }
        best.0
    }
}

struct Through<'a> {
    surfaces: &'a dyn Surfaces,
    through: [f32; BUNDLE],
}

impl Visitor for Through<'_> {
    #[inline(always)]
    fn meet<L: Lanes>(
        &mut self,
        ray: usize,
        limit: f32,
        block: &Block,
        lanes: u32,
        _t: L,
        edges: [L; 3],
    ) -> f32 {
        if lanes & !block.translucent != 0 {
            self.through[ray] = 0.0;
            return 0.0;
        }
        self.weaken(ray, limit, block, lanes, edges.map(L::store))
    }
}

impl Through<'_> {
    #[cold]
    fn weaken(&mut self, ray: usize, limit: f32, block: &Block, lanes: u32, edges: [[f32; WIDTH]; 3]) -> f32 {
        for (triangle, barycentric) in panes(block, lanes, edges) {
            let opacity = self.surfaces.opacity(triangle, barycentric);
            self.through[ray] *= 1.0 - opacity.clamp(0.0, 1.0);
        }
        if self.through[ray] > 0.0 { limit } else { 0.0 }
    }
}

struct Tinted<'a> {
    surfaces: &'a dyn Surfaces,
    tints: [Vec3; BUNDLE],
}

impl Visitor for Tinted<'_> {
    #[inline(always)]
    fn meet<L: Lanes>(
        &mut self,
        ray: usize,
        limit: f32,
        block: &Block,
        lanes: u32,
        _t: L,
        edges: [L; 3],
    ) -> f32 {
        if lanes & !block.translucent != 0 {
            self.tints[ray] = Vec3::ZERO;
            return 0.0;
        }
        self.tint(ray, limit, block, lanes, edges.map(L::store))
    }
}

impl Tinted<'_> {
    #[cold]
    fn tint(&mut self, ray: usize, limit: f32, block: &Block, lanes: u32, edges: [[f32; WIDTH]; 3]) -> f32 {
        for (triangle, barycentric) in panes(block, lanes, edges) {
            let tint = self.surfaces.transmission(triangle, barycentric);
            self.tints[ray] *= share(tint);
        }
        if self.tints[ray] != Vec3::ZERO { limit } else { 0.0 }
    }
}

/// Shares of light between 0 and 1; nothing for numbers that make no sense.
pub(crate) fn share(color: Vec3) -> Vec3 {
    if color.is_nan() { Vec3::ZERO } else { color.clamp(Vec3::ZERO, Vec3::ONE) }
}

/// The triangles of a block that a ray goes through, without the widening of the edges: where two panes meet, a ray is
/// to be weakened once.
fn panes(
    block: &Block,
    lanes: u32,
    edges: [[f32; WIDTH]; 3],
) -> impl Iterator<Item = (TriangleId, [f32; 2])> {
    (0..WIDTH).filter(move |lane| lanes & (1 << lane) != 0).filter_map(move |lane| {
        let [a, b, c] = edges.map(|edge| edge[lane]);
        let outside = a.min(b).min(c) < 0.0 && a.max(b).max(c) > 0.0;
        (!outside).then(|| (TriangleId(block.triangles[lane]), barycentric(edges, lane)))
    })
}
