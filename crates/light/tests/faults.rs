//! What users complain of in bakers: leaks, black spots and facets, each in a scene that has the fault and nothing else.
//! No option is touched.
#![allow(clippy::unwrap_used)]

use glam::Vec3;
use lightkiln_light::{
    AmbientOcclusion, Estimates, Light, Opaque, Shadows, Signal, SurfaceFlags, Surfaces, Tracer, analytic,
};
use lightkiln_mesh::{Mesh, SurfacePoint, TriangleId, VertexId, random};

#[derive(Default)]
struct Builder {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    triangles: Vec<[VertexId; 3]>,
}

impl Builder {
    fn rectangle(mut self, corner: Vec3, u: Vec3, v: Vec3) -> Self {
        let base = self.positions.len() as u32;
        self.positions.extend([corner, corner + u, corner + u + v, corner + v]);
        self.normals.extend([u.cross(v).normalize(); 4]);
        self.triangles.extend([[0, 1, 2], [0, 2, 3]].map(|t: [u32; 3]| t.map(|k| VertexId(base + k))));
        self
    }

    /// A level rectangle around the y axis that looks up.
    fn floor(self, half: f32, height: f32) -> Self {
        let corner = Vec3::new(-half, height, -half);
        self.rectangle(corner, Vec3::Z * 2.0 * half, Vec3::X * 2.0 * half)
    }

    fn cuboid(mut self, low: Vec3, high: Vec3) -> Self {
        let size = high - low;
        for axis in 0..3 {
            let along = |k: usize| Vec3::AXES[(axis + k) % 3] * size[(axis + k) % 3];
            let (u, v) = (along(1), along(2));
            self = self.rectangle(low, v, u).rectangle(low + along(0), u, v);
        }
        self
    }

    /// Part of a smooth sphere, from the north pole to a row.
    fn sphere(mut self, centre: Vec3, radius: f32, n: u32, rows: u32, outward: bool) -> Self {
        let base = self.positions.len() as u32;
        let pi = std::f32::consts::PI;
        for j in 0..=rows {
            for i in 0..2 * n {
                let (a, b) = (i as f32 / n as f32 * pi, j as f32 / n as f32 * pi);
                let ring = if j % n == 0 { 0.0 } else { b.sin() };
                let d = Vec3::new(ring * a.cos(), b.cos(), ring * a.sin());
                self.positions.push(centre + radius * d);
                self.normals.push(if outward { d } else { -d });
            }
        }
        for j in 0..rows {
            for i in 0..2 * n {
                let at = |j: u32, i: u32| base + j * 2 * n + i % (2 * n);
                for t in
                    [[at(j, i), at(j, i + 1), at(j + 1, i)], [at(j, i + 1), at(j + 1, i + 1), at(j + 1, i)]]
                {
                    let t = if outward { t } else { [t[0], t[2], t[1]] };
                    self.triangles.push(t.map(VertexId));
                }
            }
        }
        self
    }

    fn mesh(self) -> Mesh {
        Mesh::new(self.positions, self.normals, self.triangles).unwrap()
    }
}

/// The point of the surface at a place, on the first triangle with this normal.
fn at(mesh: &Mesh, place: Vec3, normal: Vec3) -> SurfacePoint {
    let found = mesh.triangle_ids().find_map(|triangle| {
        let [a, b, c] = mesh.corners(triangle).map(Vec3::as_dvec3);
        let (cross, p) = (mesh.area_vector(triangle), place.as_dvec3());
        let off = (p - a).dot(cross.normalize_or_zero()).abs();
        let weight =
            |x: glam::DVec3, y: glam::DVec3| (x - p).cross(y - p).dot(cross) / cross.length_squared();
        let (u, v) = (weight(c, a), weight(a, b));
        let faces = mesh.geometric_normal(triangle).dot(normal) > 0.999;
        let inside = u >= -1e-9 && v >= -1e-9 && u + v <= 1.0 + 1e-9;
        let barycentric = [u.clamp(0.0, 1.0) as f32, v.clamp(0.0, 1.0) as f32];
        (faces && inside && off < 1e-5).then_some(SurfacePoint { triangle, barycentric })
    });
    found.unwrap_or_else(|| panic!("no surface at {place}"))
}

fn estimate(signal: &dyn Signal, points: &[SurfacePoint], batches: u16) -> Estimates {
    let keys: Vec<u64> = (0..points.len() as u64).map(|i| random::hash(3, i, 0, 0)).collect();
    let mut estimates = Estimates::new(points.len(), signal.channels());
    estimates.refine(signal, points, &keys, &vec![batches; points.len()]);
    estimates
}

fn occlusion(mesh: &Mesh, surfaces: &dyn Surfaces, points: &[SurfacePoint]) -> Estimates {
    let tracer = Tracer::new(mesh, surfaces).unwrap();
    estimate(&AmbientOcclusion::new(&tracer, mesh, f32::INFINITY, 1), points, 64)
}

/// Hard shadows of a sun.
fn shadow(mesh: &Mesh, to_light: Vec3, points: &[SurfacePoint]) -> Estimates {
    let tracer = Tracer::new(mesh, &Opaque).unwrap();
    let sun = Light::Directional { to_light, illuminance: Vec3::ONE, angular_radius: 0.0 };
    estimate(&Shadows::new(&tracer, mesh, &[sun], 1).unwrap(), points, 2)
}

fn close(estimates: &Estimates, i: usize, expected: f64) -> bool {
    let sigma = f64::from(estimates.variance_of_mean(i, 0)).sqrt();
    (f64::from(estimates.mean(i)[0]) - expected).abs() < 4.0 * sigma
}

const DISTANCES: [f32; 5] = [1e-4, 3e-4, 1e-3, 1e-2, 0.1];

/// Rule: a wall of a millimetre keeps the light of its one side from the other, to its very base.
#[test]
fn thin_wall_in_a_room_does_not_leak_at_its_base() {
    let wall = Vec3::new(0.001, 1.0, 100.0);
    let mesh = Builder::default().floor(20.0, 0.0).cuboid(Vec3::new(0.0, 0.0, -100.0), wall).mesh();
    let place = |x: f32| at(&mesh, Vec3::new(x, 0.0, 0.3), Vec3::Y);
    let dark: Vec<_> = DISTANCES.iter().map(|d| place(0.001 + d)).collect();
    let bright: Vec<_> = DISTANCES.iter().map(|d| place(-d)).collect();
    let light = Vec3::new(-1.0, 1.0, 0.2);
    for (points, seen) in [(&dark, 0.0), (&bright, 1.0)] {
        let (shadow, occlusion) = (shadow(&mesh, light, points), occlusion(&mesh, &Opaque, points));
        for (i, &distance) in DISTANCES.iter().enumerate() {
            assert_eq!(shadow.mean(i)[0], seen, "{distance} from the wall");
            assert!(shadow.valid(i) && occlusion.valid(i), "{distance} from the wall");
            let open = 1.0 - analytic::wall_occlusion(f64::from(distance), 1.0);
            assert!(close(&occlusion, i, open), "{distance}: {:?} for {open}", occlusion.mean(i));
        }
    }
    // What the wall stands on lies inside it.
    let under = [0.0002, 0.0005, 0.0008].map(place);
    let (shadow, occlusion) = (shadow(&mesh, light, &under), occlusion(&mesh, &Opaque, &under));
    assert!((0..3).all(|i| !shadow.valid(i) && !occlusion.valid(i)));
}

/// Rule: faces that coincide do not darken each other, either way round; a face that lies inside is not judged by.
#[test]
fn coincident_faces_do_not_darken_each_other() {
    for lift in [0.0, 1.3, -77.7] {
        let corner = Vec3::new(-1.0, lift, -1.0);
        let (x, z) = (Vec3::X * 2.0, Vec3::Z * 2.0);
        let mesh =
            Builder::default().rectangle(corner, z, x).rectangle(corner, z, x).rectangle(corner, x, z).mesh();
        let points: Vec<_> = mesh
            .triangle_ids()
            .flat_map(|triangle| {
                [[0.1, 0.2], [0.3, 0.3], [0.0, 0.5]].map(|barycentric| SurfacePoint { triangle, barycentric })
            })
            .collect();
        let estimates = occlusion(&mesh, &Opaque, &points);
        assert!((0..points.len()).all(|i| estimates.mean(i)[0] == 1.0 && estimates.valid(i)));
        let estimates = shadow(&mesh, Vec3::new(0.3, 1.0, 0.1), &points);
        assert!((0..points.len()).all(|i| estimates.mean(i)[0] == f32::from(u8::from(i < 12))));
    }
    // Boxes that run through each other, with their tops in one plane or as good as.
    for step in [0.0, 1e-7, 1e-6, 1e-5, 1e-4] {
        let mesh = Builder::default()
            .cuboid(Vec3::ZERO, Vec3::new(2.0, 1.0, 1.0))
            .cuboid(Vec3::new(1.0, 0.0, 0.25), Vec3::new(3.0, 1.0 + step, 0.75))
            .mesh();
        for (number, x) in [0.5, 0.999, 1.001, 1.5, 1.9].into_iter().enumerate() {
            let points = [at(&mesh, Vec3::new(x, 1.0, 0.5), Vec3::Y)];
            let estimates = occlusion(&mesh, &Opaque, &points);
            let open = estimates.mean(0)[0] > 0.4;
            assert!(open || (!estimates.valid(0) && x > 1.0), "{x} at {step}: {:?}", estimates.mean(0));
            // Beside a step, the step is seen.
            let wall = 1.0 - analytic::wall_occlusion(f64::from((x - 1.0).abs()), f64::from(step));
            assert!(number > 1 || (close(&estimates, 0, wall) && estimates.valid(0)));
        }
        // The end of the one inside the other.
        let inside =
            [at(&mesh, Vec3::new(1.0, 0.5, 0.5), Vec3::NEG_X), at(&mesh, Vec3::new(2.0, 0.5, 0.5), Vec3::X)];
        let estimates = occlusion(&mesh, &Opaque, &inside);
        assert!(!estimates.valid(0) && !estimates.valid(1), "{:?}", estimates.means());
    }
}

struct DoubleSided;

impl Surfaces for DoubleSided {
    fn flags(&self, _: TriangleId) -> SurfaceFlags {
        SurfaceFlags { double_sided: true, ..SurfaceFlags::default() }
    }
    fn opacity(&self, _: TriangleId, _: [f32; 2]) -> f32 {
        1.0
    }
}

/// Rule: a part that is inside out darkens its neighbours as any other does, and its own outside is what its backs have.
#[test]
fn inside_out_part_darkens_as_any_other() {
    let centre = Vec3::Y * 1.2;
    let mesh = Builder::default().floor(0.6, 0.0).sphere(centre, 1.0, 32, 32, false).mesh();
    let places = [0.0_f32, 0.2, 0.4, 0.59];
    let points = places.map(|x| at(&mesh, Vec3::new(x, 0.0, 0.0), Vec3::Y));
    for surfaces in [&Opaque as &dyn Surfaces, &DoubleSided] {
        let estimates = occlusion(&mesh, surfaces, &points);
        let turned = Builder::default().floor(0.6, 0.0).sphere(centre, 1.0, 32, 32, true).mesh();
        let others = occlusion(&turned, surfaces, &points);
        for (i, &x) in places.iter().enumerate() {
            let distance = f64::from(x.hypot(1.2));
            let open = 1.0 - analytic::sphere_occlusion(distance, 1.0, 1.2 / distance);
            assert!(
                (f64::from(estimates.mean(i)[0]) - open).abs() < 0.02,
                "{x}: {:?} {open}",
                estimates.mean(i)
            );
            assert_eq!(estimates.mean(i), others.mean(i));
            // Where less than 0.7 of all that is seen is the part.
            assert!(estimates.valid(i) || open < 0.32, "{x}");
        }
    }
    let tracer = Tracer::new(&mesh, &DoubleSided).unwrap();
    let signal = AmbientOcclusion::new(&tracer, &mesh, f32::INFINITY, 1);
    for triangle in mesh.triangle_ids().filter(|t| t.0 > 100 && t.0 < 1000 && mesh.area(*t) > 0.0) {
        let point = SurfacePoint { triangle, barycentric: [0.3, 0.3] };
        let mut sides = [0.0; 2];
        for (back, out) in [false, true].into_iter().zip(&mut sides) {
            signal.batch_on_side(point, 1, 1, back, std::slice::from_mut(out));
        }
        assert!(sides[0] == 0.0 && sides[1] > 0.0, "{sides:?}");
    }
}

/// Rule: both sides of a shell have the light that is there: a half sphere is open by one half from within, everywhere
/// (form factors between points of a sphere are all alike), and wholly from without.
#[test]
fn open_shell_has_the_light_of_either_side() {
    let mesh = Builder::default().sphere(Vec3::ZERO, 1.0, 64, 32, true).mesh();
    let triangles: Vec<_> = mesh.triangle_ids().filter(|t| t.0 % 37 == 0 && mesh.area(*t) > 0.0).collect();
    let tracer = Tracer::new(&mesh, &DoubleSided).unwrap();
    let signal = AmbientOcclusion::new(&tracer, &mesh, f32::INFINITY, 1);
    for &triangle in &triangles {
        let point = SurfacePoint { triangle, barycentric: [0.3, 0.3] };
        for (back, expected) in [(false, 1.0), (true, 0.5)] {
            let batches = 200;
            let (mut mean, mut out) = (0.0, [0.0]);
            for batch in 0..batches {
                let backs = signal.batch_on_side(point, u64::from(triangle.0), batch, back, &mut out);
                assert!(backs < 0.7, "{triangle:?} is not inside");
                mean += out[0] / batches as f32;
            }
            assert!((mean - expected).abs() < 0.02, "{triangle:?} {back}: {mean}");
        }
    }
}

/// Rule: the shadow of a thing that stands on a floor begins at the thing, at any place of the world, also where rounding
/// leaves a gap or an overlap.
#[test]
fn contact_shadow_reaches_the_contact() {
    for offset in [0.0_f32, 50.0] {
        for gap in [0.0, 4e-6, -4e-6] {
            let centre = Vec3::splat(offset);
            let mut mesh = Builder::default()
                .floor(5.0, 0.0)
                .cuboid(Vec3::new(-0.5, gap, -50.0), Vec3::new(0.5, 1.0 + gap, 50.0))
                .mesh();
            mesh.positions.iter_mut().for_each(|p| *p += centre);
            let light = Vec3::new(-1.0, 1.0, 0.0);
            for (sign, seen) in [(1.0, 0.0), (-1.0, 1.0)] {
                let points = DISTANCES.map(|d| at(&mesh, centre + Vec3::X * (sign * (0.5 + d)), Vec3::Y));
                let (shadow, occlusion) = (shadow(&mesh, light, &points), occlusion(&mesh, &Opaque, &points));
                for (i, point) in points.iter().enumerate() {
                    assert_eq!(shadow.mean(i)[0], seen, "{} m off at {offset} with {gap}", DISTANCES[i]);
                    let distance = f64::from((mesh.position(*point).x - offset).abs() - 0.5);
                    let open = 1.0 - analytic::wall_occlusion(distance.max(0.0), 1.0);
                    assert!(close(&occlusion, i, open) && occlusion.valid(i) && shadow.valid(i));
                }
            }
        }
    }
}

/// Rule: a smooth surface shows none of its triangles, however few they are: open everywhere, lit where its shading normal
/// looks at the light and dark where it looks away.
#[test]
fn coarse_smooth_sphere_has_a_round_terminator() {
    for n in [6, 8, 16] {
        let mesh = Builder::default().sphere(Vec3::ZERO, 1.0, n, n, true).mesh();
        let points: Vec<_> = mesh
            .triangle_ids()
            .filter(|&t| mesh.area(t) > 0.0)
            .flat_map(|triangle| {
                (0..20).map(move |k| SurfacePoint {
                    triangle,
                    barycentric: random::square_to_triangle(random::unit2(random::hash(
                        1,
                        triangle.0.into(),
                        k,
                        0,
                    ))),
                })
            })
            .collect();
        let open = occlusion(&mesh, &Opaque, &points);
        assert!((0..points.len()).all(|i| open.mean(i)[0] == 1.0 && open.valid(i)));
        let light = Vec3::new(0.5, 0.3, 0.8).normalize();
        let lit = shadow(&mesh, light, &points);
        let (mut wrong, mut count) = (0.0, 0.0);
        for (i, &point) in points.iter().enumerate() {
            let cosine = mesh.shading_normal(point).dot(light);
            let expected = f32::from(u8::from(cosine > 0.0));
            // Within the terminator itself, what is lit has hardly any light.
            if !(0.0..=0.1).contains(&cosine) {
                assert_eq!(lit.mean(i)[0], expected, "n {n}: cosine {cosine}");
            }
            wrong += (lit.mean(i)[0] - expected).abs() * cosine.abs();
            count += cosine.abs();
        }
        assert!(wrong / count < 0.002, "n {n}: {} of the light is missing", wrong / count);
    }
}

/// Rule: what lies inside another thing is not judged by, and what lies right beside it is.
#[test]
fn leg_in_the_floor_leaves_no_spot() {
    // A floor with a thickness, and a leg that is sunk by 5 mm.
    let mesh = Builder::default()
        .cuboid(Vec3::new(-3.0, -0.1, -3.0), Vec3::new(3.0, 0.0, 3.0))
        .cuboid(Vec3::new(-0.02, -0.005, -0.02), Vec3::new(0.02, 0.5, 0.02))
        .mesh();
    let light = Vec3::new(0.6, 1.0, 0.3);
    let both = |points: &[SurfacePoint]| (occlusion(&mesh, &Opaque, points), shadow(&mesh, light, points));
    let inside: Vec<_> = [0.0, 0.01, 0.0199]
        .map(|x| at(&mesh, Vec3::new(x, 0.0, x), Vec3::Y))
        .into_iter()
        .chain([-0.0001, -0.002, -0.0049].map(|y| at(&mesh, Vec3::new(0.02, y, 0.005), Vec3::X)))
        .chain([at(&mesh, Vec3::new(0.0, -0.005, 0.0), Vec3::NEG_Y)])
        .collect();
    let (open, seen) = both(&inside);
    for i in 0..inside.len() {
        assert!(!open.valid(i) && !seen.valid(i), "{i}: {:?} {:?}", open.mean(i), seen.mean(i));
    }
    let side = |x: f32| {
        [Vec3::new(x, 0.0, -0.02), Vec3::new(x, 0.0, 0.02), Vec3::new(x, 0.5, 0.02), Vec3::new(x, 0.5, -0.02)]
    };
    for distance in DISTANCES {
        let place = Vec3::new(0.02 + distance, 0.0, 0.004);
        let points = [at(&mesh, place, Vec3::Y), at(&mesh, Vec3::new(-place.x, 0.0, -0.004), Vec3::Y)];
        let (open, seen) = both(&points);
        assert!(open.valid(0) && seen.valid(0) && open.valid(1) && seen.valid(1), "{distance}");
        // The far side of the leg does not show: one of its faces hides the others.
        let expected = 1.0 - analytic::polygon_occlusion(place, Vec3::Y, &side(0.02));
        assert!(close(&open, 0, expected), "{distance}: {:?} {expected}", open.mean(0));
        assert!(seen.mean(0)[0] == 1.0 && (seen.mean(1)[0] == 0.0) == (distance < 0.02), "{distance}");
    }
    // The leg itself, just above the floor.
    let foot = [1e-4, 1e-3].map(|y| at(&mesh, Vec3::new(0.02, y, 0.005), Vec3::X));
    let (open, seen) = both(&foot);
    assert!((0..2).all(|i| open.valid(i) && close(&open, i, 0.5) && seen.valid(i) && seen.mean(i)[0] == 1.0));
}

#[test]
fn point_a_hair_beside_a_corner_has_light_like_any_other() {
    let mesh = Builder::default().sphere(Vec3::ZERO, 1.0, 8, 8, true).mesh();
    let points: Vec<_> = mesh
        .triangle_ids()
        .filter(|&t| mesh.area(t) > 0.0)
        .flat_map(|triangle| [1e-22, 1e-30, 1e-38].map(|u| SurfacePoint { triangle, barycentric: [u, 0.0] }))
        .collect();
    let lit = shadow(&mesh, Vec3::new(0.5, 0.3, 0.8).normalize(), &points);
    assert!((0..points.len()).all(|i| (0.0..=1.0).contains(&lit.mean(i)[0])));
}
