//! Which side of a sheet is seen: tyres and caps are often exported with their fronts inside.

use glam::Vec3;
use lightkiln_light::directions::{BATCH, cosine_hemisphere, frame, net};
use lightkiln_light::{AmbientOcclusion, Light, Lighting, Origin, Surfaces, Tracer};
use lightkiln_mesh::{SurfacePoint, TriangleId, random};
use rayon::prelude::*;

use crate::Surface;
use crate::options::DEFAULT_DISTANCE;

/// Points at which a sheet is looked at from its front first, and from both sides where that is dark. Even the
/// backs of a shower's walls have no more than a tenth of the light, and a few points miss it.
const FIRST_POINTS: usize = 4;
const SIDE_POINTS: usize = 64;

/// A double-sided sheet is seen from its back when its front is darker than this, and its back brighter by this
/// factor and by more than the last number: several times the noise of that many points.
const DARK_FRONT: f32 = 0.03;
const BRIGHTER_BACK: f32 = 3.0;
const LIT_BACK: f32 = 0.01;

/// What it takes to find out what the sheets of a surface see.
struct Look<'a> {
    surface: &'a Surface<'a>,
    tracer: &'a Tracer<'a>,
    /// Up to a tenth of the scene's diagonal.
    near: AmbientOcclusion<'a>,
    /// Up to the distance of the bake, where that is farther.
    far: Option<AmbientOcclusion<'a>>,
    /// Where lights stand.
    lamps: Vec<Vec3>,
}

/// Per triangle of the light mesh: the double-sided sheet that it belongs to has its front inside of something, and its
/// back is the side that is seen.
///
/// A front is inside of something where next to nothing is open within the distance that occlusion has by default. Where
/// occlusion reaches farther, that alone says nothing: the walls of every closed room are dark without an end. Then the
/// front must see its own node alone, however far it looks, and no lamp. In a room there is something else to see.
///
/// - `distance`: what is farther away does not darken, in units of the mesh; may be infinite
///
/// The decision depends on the geometry, the distance and on where lights stand, and not on the seed of a bake, so that
/// a later look at the same file comes to the same one.
pub(crate) fn turned(
    surface: &Surface<'_>,
    tracer: &Tracer<'_>,
    distance: f32,
    lighting: &Lighting,
) -> Vec<bool> {
    let mesh = &surface.mesh;
    let (low, high) = mesh.bounds();
    let occlusion = |distance| AmbientOcclusion::new(tracer, surface.world(), distance, 0);
    let usual = DEFAULT_DISTANCE * (high - low).length();
    let far = (distance > usual).then(|| occlusion(distance));
    let lamps = lighting.lights.iter().filter_map(place).collect();
    let look = Look { surface, tracer, near: occlusion(usual), far, lamps };
    let (sheet_of, count) = lightkiln_mesh::sheets(mesh);
    let mut triangles: Vec<Vec<TriangleId>> = vec![Vec::new(); count];
    let mut open_to_question = vec![true; count];
    for t in mesh.triangle_ids() {
        let sheet = sheet_of[t.index()] as usize;
        open_to_question[sheet] &= surface.flags(t).double_sided;
        triangles[sheet].push(t);
    }
    let turned: Vec<bool> = triangles
        .par_iter()
        .zip(&open_to_question)
        .map(|(triangles, &open)| open && look.is_seen_from_behind(triangles))
        .collect();
    sheet_of.iter().map(|&sheet| turned[sheet as usize]).collect()
}

/// Where a light stands; a sun stands nowhere.
fn place(light: &Light) -> Option<Vec3> {
    match *light {
        Light::Directional { .. } => None,
        Light::Sphere { position, .. } | Light::Spot { position, .. } | Light::Disk { position, .. } => {
            Some(position)
        }
        Light::Quad { corner, edges: [u, v], .. } => Some(corner + 0.5 * (u + v)),
    }
}

impl Look<'_> {
    fn is_seen_from_behind(&self, triangles: &[TriangleId]) -> bool {
        let front = self.front(&self.near, triangles);
        if front < DARK_FRONT {
            return self.back_is_brighter(triangles, front);
        }
        let Some(far) = &self.far else { return false };
        let front = self.front(far, triangles);
        front < DARK_FRONT && self.sees_itself_alone(triangles) && self.back_is_brighter(triangles, front)
    }

    /// How open the front of a sheet is; a few points will do where that is more than a little.
    fn front(&self, occlusion: &AmbientOcclusion<'_>, triangles: &[TriangleId]) -> f32 {
        let few = self.openness(occlusion, triangles, FIRST_POINTS, false);
        if few > 2.0 * DARK_FRONT { few } else { self.openness(occlusion, triangles, SIDE_POINTS, false) }
    }

    fn back_is_brighter(&self, triangles: &[TriangleId], front: f32) -> bool {
        self.openness(&self.near, triangles, SIDE_POINTS, true) > BRIGHTER_BACK * front + LIT_BACK
    }

    /// The ambient occlusion of one side of a sheet by a batch at each of some points.
    fn openness(
        &self,
        occlusion: &AmbientOcclusion<'_>,
        triangles: &[TriangleId],
        points: usize,
        back: bool,
    ) -> f32 {
        let open = |(point, key)| {
            let mut out = [0.0];
            occlusion.batch_on_side(point, key, 1, back, &mut out);
            out[0]
        };
        self.points(triangles, points).map(open).sum::<f32>() / points as f32
    }

    /// Whether the front of a sheet sees nothing but the node that it belongs to: nothing else, no light, and not out.
    fn sees_itself_alone(&self, triangles: &[TriangleId]) -> bool {
        // What is seen lies between these.
        let (mut low, mut high) = (Vec3::MAX, Vec3::MIN);
        // Rays that may slip through cracks.
        let mut spare = (DARK_FRONT * (SIDE_POINTS * BATCH) as f32) as usize;
        for (point, key) in self.points(triangles, SIDE_POINTS) {
            let Some((origin, normal)) = Origin::on_side(self.tracer, self.surface.world(), point, false)
            else {
                continue;
            };
            let [x, y] = frame(normal);
            let directions = net(key).map(|square| {
                let local = cosine_hemisphere(square);
                x * local.x + y * local.y + normal * local.z
            });
            let mut hits = [None; BATCH];
            self.tracer.first_hits(origin, &directions, f32::INFINITY, &mut hits);
            let place = self.surface.mesh.position(point);
            for (hit, direction) in hits.into_iter().zip(directions) {
                match hit {
                    Some(hit) => {
                        let shines = self.surface.emission(hit.triangle, hit.barycentric) != Vec3::ZERO;
                        if shines || !self.surface.is_same_node(point.triangle, hit.triangle) {
                            return false;
                        }
                        let seen = place + direction * hit.distance;
                        (low, high) = (low.min(seen), high.max(seen));
                    }
                    None if spare == 0 => return false,
                    None => spare -= 1,
                }
            }
        }
        !self.lamps.iter().any(|lamp| lamp.cmpge(low).all() && lamp.cmple(high).all())
    }

    /// Points of a sheet, equally spaced by area, with a key each.
    fn points(&self, triangles: &[TriangleId], count: usize) -> impl Iterator<Item = (SurfacePoint, u64)> {
        let mesh = &self.surface.mesh;
        let total: f64 = triangles.iter().map(|&t| mesh.area(t)).sum();
        let (mut before, mut next) = (0.0, 0);
        triangles.iter().flat_map(move |&triangle| {
            before += mesh.area(triangle);
            let first = next;
            // As many as fall into this triangle.
            while next < count && (next as f64 + 0.5) / count as f64 * total <= before {
                next += 1;
            }
            (first..next).map(move |number| {
                let key = random::hash(0, u64::from(triangle.0), number as u64, 0);
                let barycentric = random::square_to_triangle(random::unit2(key));
                (SurfacePoint { triangle, barycentric }, key)
            })
        })
    }
}
