//! Light against closed forms.
#![allow(clippy::unwrap_used)]

use std::f32::consts::PI;

use glam::Vec3;
use lightkiln_light::{
    Environment, Estimates, Light, LightError, Lighting, Output, PathOptions, PathTraced, Signal,
    SurfaceFlags, Surfaces, Tracer, analytic, harmonics,
};
use lightkiln_mesh::{Mesh, SurfacePoint, TriangleId, VertexId, random};

/// Quadrilaterals, two triangles each: quadrilateral `i` has triangles `2 i` and `2 i + 1`.
fn quads(corners: &[[Vec3; 4]]) -> Mesh {
    let mut positions = Vec::new();
    let mut normals = Vec::new();
    let mut triangles = Vec::new();
    for quad in corners {
        let base = positions.len() as u32;
        let n = (quad[1] - quad[0]).cross(quad[2] - quad[0]).normalize();
        positions.extend(quad);
        normals.extend([n; 4]);
        triangles.extend([[0, 1, 2], [0, 2, 3]].map(|t: [u32; 3]| t.map(|k| VertexId(base + k))));
    }
    Mesh::new(positions, normals, triangles).unwrap()
}

/// A parallelogram whose front is on the side of `u x v`.
fn patch(corner: Vec3, u: Vec3, v: Vec3) -> [Vec3; 4] {
    [corner, corner + u, corner + u + v, corner + v]
}

/// A level square around the origin whose front is up (+y).
fn floor(half: f32) -> [Vec3; 4] {
    patch(Vec3::new(-half, 0.0, -half), Vec3::Z * 2.0 * half, Vec3::X * 2.0 * half)
}

/// The six sides of a box, seen from inside.
fn room(half: Vec3) -> Vec<[Vec3; 4]> {
    let mut sides = Vec::new();
    for axis in 0..3 {
        let u = Vec3::AXES[(axis + 1) % 3] * half[(axis + 1) % 3];
        let v = Vec3::AXES[(axis + 2) % 3] * half[(axis + 2) % 3];
        let w = Vec3::AXES[axis] * half[axis];
        sides.push(patch(-w - u - v, 2.0 * u, 2.0 * v));
        sides.push(patch(w - u - v, 2.0 * v, 2.0 * u));
    }
    sides
}

/// The surface point of a position in one of the quadrilaterals.
fn at(mesh: &Mesh, quad: u32, position: Vec3) -> SurfacePoint {
    for triangle in [TriangleId(2 * quad), TriangleId(2 * quad + 1)] {
        let [a, b, c] = mesh.corners(triangle);
        let n = mesh.area_vector(triangle).as_vec3();
        let u = (position - a).cross(c - a).dot(n) / n.length_squared();
        let v = (b - a).cross(position - a).dot(n) / n.length_squared();
        if u >= 0.0 && v >= 0.0 && u + v <= 1.0 {
            return SurfacePoint { triangle, barycentric: [u, v] };
        }
    }
    panic!("{position} is not on quadrilateral {quad}")
}

/// What each quadrilateral is.
#[derive(Clone, Copy, Default)]
struct Paint {
    albedo: Vec3,
    emission: Vec3,
    transmission: Option<Vec3>,
    double_sided: bool,
}

struct Paints(Vec<Paint>);

impl Paints {
    fn of(&self, t: TriangleId) -> Paint {
        self.0.get(t.index() / 2).or(self.0.last()).copied().unwrap_or_default()
    }
}

impl Surfaces for Paints {
    fn flags(&self, t: TriangleId) -> SurfaceFlags {
        let paint = self.of(t);
        SurfaceFlags {
            translucent: paint.transmission.is_some(),
            double_sided: paint.double_sided,
            ..SurfaceFlags::default()
        }
    }
    fn opacity(&self, t: TriangleId, _: [f32; 2]) -> f32 {
        1.0 - self.of(t).transmission.unwrap_or_default().max_element()
    }
    fn albedo(&self, t: TriangleId, _: [f32; 2]) -> Vec3 {
        self.of(t).albedo
    }
    fn emission(&self, t: TriangleId, _: [f32; 2]) -> Vec3 {
        self.of(t).emission
    }
    fn transmission(&self, t: TriangleId, _: [f32; 2]) -> Vec3 {
        self.of(t).transmission.unwrap_or_default()
    }
}

fn black() -> Paints {
    Paints(vec![Paint::default()])
}

fn grey(albedo: f32) -> Paint {
    Paint { albedo: Vec3::splat(albedo), ..Paint::default() }
}

fn lit(lights: &[Light]) -> Lighting {
    Lighting { lights: lights.to_vec(), environment: None }
}

fn sky(environment: Environment) -> Lighting {
    Lighting { lights: Vec::new(), environment: Some(environment) }
}

/// Values of all outputs at points, and their standard errors by the spread of batches.
fn bake(
    mesh: &Mesh,
    paints: &Paints,
    lighting: &Lighting,
    outputs: &[Output],
    points: &[SurfacePoint],
    batches: u16,
    options: PathOptions,
) -> Estimates {
    let tracer = Tracer::new(mesh, paints).unwrap();
    let signal = PathTraced::new(&tracer, mesh, lighting, outputs, options).unwrap();
    let mut estimates = Estimates::new(points.len(), signal.channels());
    let keys: Vec<u64> = (0..points.len() as u64).map(|i| random::hash(31, i, 0, 0)).collect();
    estimates.refine(&signal, points, &keys, &vec![batches; points.len()]);
    estimates
}

/// Green irradiance at one point, and its standard error.
fn irradiance(
    mesh: &Mesh,
    paints: &Paints,
    lighting: &Lighting,
    point: SurfacePoint,
    batches: u16,
) -> [f32; 2] {
    let options = PathOptions::default();
    let e = bake(mesh, paints, lighting, &[Output::Irradiance], &[point], batches, options);
    [e.mean(0)[1], e.spread_variance_of_mean(0, 1).sqrt()]
}

/// Within four standard errors, which are to be small, and a little rounding.
#[track_caller]
fn assert_near([value, sigma]: [f32; 2], truth: f32, noise: f32) {
    assert!(sigma <= noise * truth, "noise of {sigma} for {truth}");
    assert!((value - truth).abs() <= 4.0 * sigma + 2e-4 * truth, "{value} +- {sigma}, not {truth}");
}

#[test]
fn sky_even_over_a_plane_gives_pi_radiance() {
    let mesh = quads(&[floor(1.0)]);
    let point = at(&mesh, 0, Vec3::new(0.1, 0.0, 0.2));
    let sky = sky(Environment::constant(Vec3::new(1.0, 3.0, 5.0)).unwrap());
    assert_near(irradiance(&mesh, &black(), &sky, point, 1), 3.0 * PI, 0.0);
}

#[test]
fn sky_even_over_a_wall_covers_half() {
    let mesh = quads(&[floor(1.0), patch(Vec3::new(-900.0, 0.0, 0.0), Vec3::X * 1800.0, Vec3::Y * 900.0)]);
    let point = at(&mesh, 0, Vec3::new(0.0, 0.0, 0.01));
    let sky = sky(Environment::constant(Vec3::ONE).unwrap());
    assert_near(irradiance(&mesh, &black(), &sky, point, 400), 0.5 * PI, 0.01);
}

#[test]
fn sky_on_a_tilted_shading_normal_is_still_even() {
    let mut mesh = quads(&[floor(1.0)]);
    mesh.normals.iter_mut().for_each(|n| *n = Vec3::new(0.8, 0.6, 0.0));
    let point = at(&mesh, 0, Vec3::new(0.1, 0.0, 0.2));
    let even = sky(Environment::constant(Vec3::ONE).unwrap());
    assert_near(irradiance(&mesh, &black(), &even, point, 4), PI, 1e-5);
}

#[test]
fn sun_gives_its_lux_times_cosine() {
    let mesh = quads(&[floor(1.0)]);
    let point = at(&mesh, 0, Vec3::new(0.1, 0.0, 0.2));
    let sun = |radius| Light::Directional {
        to_light: Vec3::new(3.0, 4.0, 0.0),
        illuminance: Vec3::splat(100.0),
        angular_radius: radius,
    };
    assert_near(irradiance(&mesh, &black(), &lit(&[sun(0.0)]), point, 2), 80.0, 0.0);
    // Soft ones give as much as long as all of it is above the horizon.
    assert_near(irradiance(&mesh, &black(), &lit(&[sun(0.5)]), point, 200), 80.0, 0.002);
    let low = Light::sun(0.4, -0.1, Vec3::splat(100.0));
    assert_eq!(irradiance(&mesh, &black(), &lit(&[low]), point, 2)[0], 0.0);
}

#[test]
fn sun_by_azimuth_and_elevation_stands_where_it_says() {
    let Light::Directional { to_light, .. } = Light::sun(PI / 2.0, PI / 6.0, Vec3::ONE) else { panic!() };
    assert!((to_light - Vec3::new(0.75_f32.sqrt(), 0.5, 0.0)).length() < 1e-6, "{to_light}");
    let Light::Directional { to_light, .. } = Light::sun(0.0, 0.0, Vec3::ONE) else { panic!() };
    assert!((to_light + Vec3::Z).length() < 1e-6, "{to_light}");
}

#[test]
fn sphere_light_gives_inverse_squares_of_any_size() {
    let mesh = quads(&[floor(1.0)]);
    let point = at(&mesh, 0, Vec3::ZERO);
    for (radius, batches, noise) in [(0.0, 1, 0.0), (0.01, 50, 0.001), (0.9, 400, 0.003), (1.9, 1600, 0.01)] {
        let light = Light::Sphere {
            position: Vec3::new(1.2, 1.6, 0.0),
            intensity: Vec3::splat(100.0),
            radius,
            range: f32::INFINITY,
        };
        let (height, distance) = (1.6, 2.0_f32);
        // Exact as long as all of the sphere is above the horizon.
        let value = irradiance(&mesh, &black(), &lit(&[light]), point, batches);
        if radius < height {
            assert_near(value, 100.0 * (height / distance) / distance.powi(2), noise);
        } else {
            assert!(value[0] > 20.0, "{value:?}");
        }
    }
}

#[test]
fn sphere_light_fades_at_its_range() {
    let mesh = quads(&[floor(1.0)]);
    let point = at(&mesh, 0, Vec3::ZERO);
    let light =
        |range| Light::Sphere { position: Vec3::Y * 2.0, intensity: Vec3::splat(100.0), radius: 0.0, range };
    assert_near(irradiance(&mesh, &black(), &lit(&[light(4.0)]), point, 1), 25.0 * (1.0 - 0.0625), 0.0);
    assert_eq!(irradiance(&mesh, &black(), &lit(&[light(1.9)]), point, 1)[0], 0.0);
}

#[test]
fn spot_light_fills_its_cone() {
    let mesh = quads(&[floor(10.0)]);
    let (inner, outer) = (0.3_f32, 0.6_f32);
    let spot = Light::Spot {
        position: Vec3::Y * 2.0,
        direction: Vec3::NEG_Y * 3.0,
        intensity: Vec3::splat(100.0),
        inner,
        outer,
        radius: 0.0,
        range: f32::INFINITY,
    };
    for angle in [0.0_f32, 0.2, 0.4, 0.5, 0.7] {
        let point = at(&mesh, 0, Vec3::X * 2.0 * angle.tan());
        let share = ((angle.cos() - outer.cos()) / (inner.cos() - outer.cos())).clamp(0.0, 1.0).powi(2);
        let value = irradiance(&mesh, &black(), &lit(&[spot]), point, 1);
        assert_near(value, 25.0 * share * angle.cos().powi(3), 0.0);
    }
}

#[test]
fn disk_light_above_a_plane_is_its_form_factor() {
    let mesh = quads(&[floor(1.0)]);
    let point = at(&mesh, 0, Vec3::ZERO);
    let disk = Light::Disk {
        position: Vec3::Y * 1.5,
        direction: Vec3::NEG_Y,
        radius: 1.0,
        radiance: Vec3::splat(10.0),
    };
    let truth = 10.0 * PI * analytic::disk_occlusion(1.5, 1.0) as f32;
    assert_near(irradiance(&mesh, &black(), &lit(&[disk]), point, 200), truth, 0.002);
    let away = Light::Disk { position: Vec3::Y, direction: Vec3::Y, radius: 1.0, radiance: Vec3::ONE };
    assert_eq!(irradiance(&mesh, &black(), &lit(&[away]), point, 1)[0], 0.0);
}

#[test]
fn quad_light_is_its_form_factor_also_across_the_horizon() {
    let mesh = quads(&[floor(1.0)]);
    let point = at(&mesh, 0, Vec3::ZERO);
    for (corner, u, v) in [
        (Vec3::new(-0.5, 1.0, -0.7), Vec3::X, Vec3::Z * 1.4),
        (Vec3::new(-1.0, -0.8, -0.6), Vec3::X * 2.0, Vec3::Y * 2.0),
    ] {
        let quad = Light::Quad { corner, edges: [u, v], radiance: Vec3::splat(10.0) };
        let truth = 10.0 * PI * analytic::polygon_occlusion(Vec3::ZERO, Vec3::Y, &patch(corner, u, v)) as f32;
        assert_near(irradiance(&mesh, &black(), &lit(&[quad]), point, 1000), truth, 0.005);
    }
}

#[test]
fn emitting_triangles_are_a_quad_light_of_their_size() {
    let corners = patch(Vec3::new(-0.5, 1.0, -0.7), Vec3::X, Vec3::Z * 1.4);
    let mesh = quads(&[floor(1.0), corners]);
    let paints = Paints(vec![Paint::default(), Paint { emission: Vec3::splat(10.0), ..Paint::default() }]);
    let point = at(&mesh, 0, Vec3::new(0.3, 0.0, 0.1));
    let position = mesh.position(point);
    let truth = 10.0 * PI * analytic::polygon_occlusion(position, Vec3::Y, &corners) as f32;
    let value = irradiance(&mesh, &paints, &Lighting::default(), point, 300);
    assert_near(value, truth, 0.005);
    let quad = Light::Quad {
        corner: corners[0],
        edges: [corners[1] - corners[0], corners[3] - corners[0]],
        radiance: Vec3::splat(10.0),
    };
    let alone = irradiance(&quads(&[floor(1.0)]), &black(), &lit(&[quad]), point, 300);
    assert!((alone[0] - value[0]).abs() < 4.0 * value[1].hypot(alone[1]), "{alone:?} {value:?}");
}

#[test]
fn emitting_backs_are_dark_unless_double_sided() {
    let corners = patch(Vec3::new(-0.5, 1.0, -0.7), Vec3::Z * 1.4, Vec3::X);
    let mesh = quads(&[floor(1.0), corners]);
    let point = at(&mesh, 0, Vec3::ZERO);
    let lamp = Paint { emission: Vec3::splat(10.0), ..Paint::default() };
    let one = Paints(vec![Paint::default(), lamp]);
    assert_eq!(irradiance(&mesh, &one, &Lighting::default(), point, 20)[0], 0.0);
    let two = Paints(vec![Paint::default(), Paint { double_sided: true, ..lamp }]);
    let truth = 10.0 * PI * analytic::polygon_occlusion(Vec3::ZERO, Vec3::Y, &corners) as f32;
    assert_near(irradiance(&mesh, &two, &Lighting::default(), point, 300), truth, 0.005);
}

#[test]
fn penumbra_of_a_straight_edge_is_the_area_that_is_seen() {
    // A quad light of 1 x 1 at height 4 over an edge at height 1: the share grows linearly across the penumbra.
    let roof = patch(Vec3::new(0.0, 1.0, -500.0), Vec3::Z * 1000.0, Vec3::X * 500.0);
    let mesh = quads(&[floor(3.0), roof]);
    let corner = Vec3::new(-0.5, 4.0, -0.5);
    let light =
        |wide: f32| Light::Quad { corner, edges: [Vec3::X * wide, Vec3::Z], radiance: Vec3::splat(100.0) };
    for step in -5..=5_i16 {
        let x = f32::from(step) * 0.04;
        let point = at(&mesh, 0, Vec3::X * x);
        let value = irradiance(&mesh, &black(), &lit(&[light(1.0)]), point, 300);
        // Seen from x, the edge cuts the light's plane at -3 x; what lies on the side of -x is seen.
        let wide = (-3.0 * x - corner.x).clamp(0.0, 1.0);
        let part = patch(corner, Vec3::X * wide, Vec3::Z);
        let truth = 100.0 * PI * analytic::polygon_occlusion(Vec3::X * x, Vec3::Y, &part) as f32;
        assert!(
            (value[0] - truth).abs() <= 4.0 * value[1] + 1e-3 * truth + 0.005,
            "{x}: {value:?}, not {truth}"
        );
    }
}

#[test]
fn furnace_holds_emission_over_one_minus_albedo() {
    let mesh = quads(&room(Vec3::new(1.0, 0.6, 2.0)));
    for albedo in [0.2, 0.5, 0.8] {
        let paints = Paints(vec![Paint { emission: Vec3::splat(2.0), ..grey(albedo) }]);
        let point = at(&mesh, 3, Vec3::new(0.1, 0.6, 0.3));
        let value = irradiance(&mesh, &paints, &Lighting::default(), point, 600);
        assert_near(value, 2.0 * PI / (1.0 - albedo), 0.01);
    }
}

#[test]
fn direct_and_indirect_are_parts_of_irradiance() {
    let mesh = quads(&room(Vec3::ONE));
    let mut paints = vec![grey(0.6); 6];
    paints[3].emission = Vec3::splat(3.0);
    let outputs = [Output::Irradiance, Output::Indirect, Output::Direct];
    let points = [at(&mesh, 2, Vec3::new(0.2, -1.0, 0.4)), at(&mesh, 0, Vec3::new(-1.0, 0.5, 0.4))];
    let lamp =
        Light::Sphere { position: Vec3::ZERO, intensity: Vec3::ONE, radius: 0.1, range: f32::INFINITY };
    let options = PathOptions::default();
    let e = bake(&mesh, &Paints(paints), &lit(&[lamp]), &outputs, &points, 40, options);
    for i in 0..points.len() {
        for c in 0..3 {
            let [whole, indirect, direct] = [0, 3, 6].map(|k| e.mean(i)[k + c]);
            assert!((whole - indirect - direct).abs() < 1e-4 * whole && indirect > 0.0 && direct > 0.0);
        }
    }
}

#[test]
fn indirect_grows_with_bounces_and_converges() {
    let mesh = quads(&room(Vec3::ONE));
    let albedo = 0.5;
    let paints = Paints(vec![Paint { emission: Vec3::ONE, ..grey(albedo) }]);
    let point = at(&mesh, 2, Vec3::new(0.2, -1.0, 0.4));
    for bounces in 0..6 {
        let options = PathOptions { bounces, ..PathOptions::default() };
        let e = bake(&mesh, &paints, &Lighting::default(), &[Output::Indirect], &[point], 400, options);
        // The furnace's series: pi (a + a^2 + ..).
        let truth = PI * (1..=bounces).map(|k| albedo.powi(k as i32)).sum::<f32>();
        assert_near([e.mean(0)[0], e.spread_variance_of_mean(0, 0).sqrt()], truth, 0.01);
    }
}

#[test]
fn indirect_with_a_clamp_is_darker_never_brighter() {
    let mesh = quads(&room(Vec3::ONE));
    let mut paints = vec![grey(0.7); 6];
    paints[3].emission = Vec3::splat(3.0);
    let paints = Paints(paints);
    let point = [at(&mesh, 2, Vec3::new(0.2, -1.0, 0.4))];
    let run = |clamp| {
        let options = PathOptions { clamp, ..PathOptions::default() };
        bake(&mesh, &paints, &Lighting::default(), &[Output::Indirect, Output::Direct], &point, 100, options)
    };
    let (free, wide, tight) = (run(None), run(Some(1e9)), run(Some(1.0)));
    assert_eq!(free, wide);
    assert!(tight.mean(0)[0] <= 1.0 && tight.mean(0)[0] < free.mean(0)[0] && tight.mean(0)[0] > 0.0);
    assert_eq!(tight.mean(0)[3], free.mean(0)[3]);
}

#[test]
fn quad_light_in_the_plane_of_the_ceiling_is_seen() {
    let mesh = quads(&room(Vec3::new(7.3, 2.9, 5.1)));
    let quad = Light::Quad {
        corner: Vec3::new(-0.5, 2.9, -0.5),
        edges: [Vec3::X, Vec3::Z],
        radiance: Vec3::splat(100.0),
    };
    let place = Vec3::new(3.3, -2.9, 2.7);
    let point = at(&mesh, 2, place);
    let corners = patch(Vec3::new(-0.5, 2.9, -0.5), Vec3::X, Vec3::Z);
    let truth = 100.0 * PI * analytic::polygon_occlusion(place, Vec3::Y, &corners) as f32;
    assert_near(irradiance(&mesh, &black(), &lit(&[quad]), point, 20), truth, 0.002);
}

#[test]
fn floor_beside_a_wall_gets_one_bounce_of_the_sun() {
    // A wall of albedo a in full sun is a quad light of radiance a E / pi.
    let wall = patch(Vec3::new(-2.0, 0.0, -1.0), Vec3::X * 4.0, Vec3::Y * 3.0);
    let mesh = quads(&[floor(0.5), wall]);
    let paints = Paints(vec![grey(0.0), grey(0.7)]);
    let sun = Light::Directional { to_light: Vec3::Z, illuminance: Vec3::splat(100.0), angular_radius: 0.0 };
    let point = at(&mesh, 0, Vec3::new(0.2, 0.0, 0.1));
    let form = analytic::polygon_occlusion(mesh.position(point), Vec3::Y, &wall) as f32;
    assert_near(irradiance(&mesh, &paints, &lit(&[sun]), point, 400), 70.0 * form, 0.01);
}

#[test]
fn glass_tints_what_goes_through() {
    let pane = |y: f32| patch(Vec3::new(-50.0, y, -50.0), Vec3::Z * 100.0, Vec3::X * 100.0);
    let mesh = quads(&[floor(0.5), pane(0.5), pane(1.0)]);
    let tint = Vec3::new(0.9, 0.5, 0.1);
    let glass = Paint { transmission: Some(tint), ..Paint::default() };
    let paints = Paints(vec![Paint::default(), glass, glass]);
    let point = at(&mesh, 0, Vec3::new(0.1, 0.0, 0.2));
    let sun = Light::sun(0.0, PI / 2.0, Vec3::splat(100.0));
    let options = PathOptions::default();
    let e = bake(&mesh, &paints, &lit(&[sun]), &[Output::Irradiance], &[point], 40, options);
    assert!((Vec3::from_slice(e.mean(0)) - 100.0 * tint * tint).length() < 0.1, "{:?}", e.mean(0));
    // The sky comes by rays that go on by chance.
    let even = sky(Environment::constant(Vec3::ONE).unwrap());
    let e = bake(&mesh, &paints, &even, &[Output::Irradiance], &[point], 2000, options);
    for c in 0..3 {
        let [value, sigma] = [e.mean(0)[c], e.spread_variance_of_mean(0, c).sqrt()];
        // A hundredth of the sky comes in below the panes.
        let truth = PI * tint[c] * tint[c];
        assert!((value - truth).abs() < 4.0 * sigma + 0.002, "{c}: {value} +- {sigma}, not {truth}");
    }
}

#[test]
fn harmonics_of_an_even_sky_over_a_plane() {
    let mesh = quads(&[floor(1.0)]);
    let point = at(&mesh, 0, Vec3::new(0.1, 0.0, 0.2));
    let even = sky(Environment::constant(Vec3::ONE).unwrap());
    let outputs = [Output::Harmonics { bands: 3 }, Output::Irradiance];
    let e = bake(&mesh, &black(), &even, &outputs, &[point], 2000, PathOptions::default());
    // Integrals of the harmonics over the upper half, times pi, 2 pi / 3 and pi / 4.
    let mut truth = [0.0; 9];
    truth[0] = 0.282_094_8 * 2.0 * PI * PI;
    truth[1] = 0.488_602_5 * PI * 2.0 * PI / 3.0;
    for (k, truth) in truth.iter().enumerate() {
        let [value, sigma] = [e.mean(0)[3 * k], e.spread_variance_of_mean(0, 3 * k).sqrt()];
        assert!(
            (value - truth).abs() < 4.0 * sigma + 1e-4 && sigma < 0.02,
            "{k}: {value} +- {sigma}, not {truth}"
        );
    }
    assert_near([e.mean(0)[27], e.spread_variance_of_mean(0, 27).sqrt()], PI, 0.01);
}

#[test]
fn harmonics_of_one_light_are_those_of_its_direction() {
    let mesh = quads(&[floor(1.0)]);
    let point = at(&mesh, 0, Vec3::new(0.1, 0.0, 0.2));
    let to_light = Vec3::new(0.36, 0.8, 0.48);
    let sun = Light::Directional { to_light, illuminance: Vec3::splat(100.0), angular_radius: 0.0 };
    let outputs = [Output::Harmonics { bands: 3 }];
    let e = bake(&mesh, &black(), &lit(&[sun]), &outputs, &[point], 1, PathOptions::default());
    let coefficients: Vec<Vec3> = e.mean(0).chunks(3).map(Vec3::from_slice).collect();
    let basis = harmonics::basis(to_light);
    for k in 0..9 {
        let truth = 100.0 * basis[k] * harmonics::cosine_factor(k);
        assert!((coefficients[k].y - truth).abs() < 1e-3, "{k}: {} {truth}", coefficients[k]);
    }
    // Facing the light: 1/4 + 1/2 + 5/16 of it, which is the clamped cosine of three bands.
    let facing = harmonics::irradiance(&coefficients, to_light).y;
    assert!((facing - 106.25).abs() < 0.01, "{facing}");
}

#[test]
fn terminator_of_a_coarse_sphere_is_that_of_a_smooth_one() {
    // 16 x 8 facets with smooth normals, sun from +x: irradiance is the clamped cosine of the shading normal.
    let n = 8_u32;
    let mut positions = Vec::new();
    for j in 0..=n {
        for i in 0..2 * n {
            let (a, b) = (i as f32 / n as f32 * PI, j as f32 / n as f32 * PI);
            let ring = if j % n == 0 { 0.0 } else { b.sin() };
            positions.push(Vec3::new(ring * a.cos(), b.cos(), ring * a.sin()));
        }
    }
    let mut triangles = Vec::new();
    for j in 0..n {
        for i in 0..2 * n {
            let at = |j: u32, i: u32| VertexId(j * 2 * n + i % (2 * n));
            triangles.push([at(j, i), at(j, i + 1), at(j + 1, i)]);
            triangles.push([at(j, i + 1), at(j + 1, i + 1), at(j + 1, i)]);
        }
    }
    let mesh = Mesh::new(positions.clone(), positions, triangles).unwrap();
    let sun = Light::Directional { to_light: Vec3::X, illuminance: Vec3::ONE, angular_radius: 0.0 };
    let points: Vec<SurfacePoint> = (0..4000_u64)
        .map(|i| SurfacePoint {
            triangle: TriangleId((i % mesh.triangle_count() as u64) as u32),
            barycentric: random::square_to_triangle(random::unit2(random::hash(1, i, 0, 0))),
        })
        .filter(|p| mesh.area(p.triangle) > 0.0)
        .collect();
    let e = bake(&mesh, &black(), &lit(&[sun]), &[Output::Direct], &points, 1, PathOptions::default());
    let wrong = points
        .iter()
        .enumerate()
        .filter(|&(i, &p)| (e.mean(i)[0] - mesh.shading_normal(p).x.max(0.0)).abs() > 0.01);
    let wrong = wrong.count();
    assert!(wrong * 500 <= points.len(), "{wrong} of {}", points.len());
}

#[test]
fn many_lights_are_the_sum_of_each() {
    let mesh = quads(&[floor(4.0)]);
    let lights: Vec<Light> = (0..60_u64)
        .map(|i| {
            let h = |k| random::unit(random::hash(3, i, k, 0));
            Light::Sphere {
                position: Vec3::new(8.0 * h(0) - 4.0, 0.5 + h(1), 8.0 * h(2) - 4.0),
                intensity: Vec3::splat(0.2 + h(3) * if i == 0 { 100.0 } else { 1.0 }),
                radius: if i % 3 == 0 { 0.2 } else { 0.0 },
                range: f32::INFINITY,
            }
        })
        .collect();
    let point = at(&mesh, 0, Vec3::new(0.3, 0.0, 0.2));
    let truth: f32 = lights.iter().map(|&l| irradiance(&mesh, &black(), &lit(&[l]), point, 64)[0]).sum();
    assert_near(irradiance(&mesh, &black(), &lit(&lights), point, 400), truth, 0.01);
}

#[test]
fn lighting_that_makes_no_sense_is_refused() {
    let mesh = quads(&[floor(1.0)]);
    let paints = black();
    let tracer = Tracer::new(&mesh, &paints).unwrap();
    let good = Light::sun(0.0, 1.0, Vec3::ONE);
    let sphere = |intensity: f32, radius: f32, range: f32| Light::Sphere {
        position: Vec3::ZERO,
        intensity: Vec3::splat(intensity),
        radius,
        range,
    };
    for (bad, what) in [
        (Light::sun(0.0, 1.0, Vec3::NAN), "illuminance"),
        (sphere(-1.0, 0.0, 1.0), "intensity"),
        (sphere(1.0, -1.0, 1.0), "radius"),
        (sphere(1.0, 0.0, f32::NAN), "range"),
        (Light::Quad { corner: Vec3::ZERO, edges: [Vec3::X; 2], radiance: Vec3::ONE }, "edges"),
    ] {
        let lighting = lit(&[good, bad]);
        let refused =
            PathTraced::new(&tracer, &mesh, &lighting, &[Output::Direct], PathOptions::default()).err();
        assert_eq!(refused, Some(LightError::Light { light: 1, what }));
    }
    let dark = Environment::constant(Vec3::ZERO).err();
    assert_eq!(dark, Some(LightError::Environment { pixel: None }));
    let negative = Environment::lat_long(2, 1, vec![Vec3::ONE, -Vec3::ONE], 0.0, 1.0).err();
    assert_eq!(negative, Some(LightError::Environment { pixel: Some(1) }));
    let empty = Environment::lat_long(0, 4, Vec::new(), 0.0, 1.0).err();
    assert_eq!(empty, Some(LightError::EnvironmentSize { width: 0, height: 4, pixels: 0 }));
}

#[test]
fn studio_gives_a_level_surface_what_it_says() {
    let mesh = quads(&[floor(1.0)]);
    let point = at(&mesh, 0, Vec3::ZERO);
    let truth = PI * 200.0 + 100.0 * 2.0 * PI / 3.0 + 500.0 * 50_f32.to_radians().sin();
    assert_near(irradiance(&mesh, &black(), &Lighting::studio(), point, 400), truth, 0.01);
}

#[test]
fn one_thread_and_many_agree_bit_for_bit() {
    let mesh = quads(&room(Vec3::ONE));
    let mut paints = vec![grey(0.6); 6];
    paints[3].emission = Vec3::splat(3.0);
    let paints = Paints(paints);
    let points: Vec<SurfacePoint> = (0..400_u64)
        .map(|i| SurfacePoint {
            triangle: TriangleId((i % 12) as u32),
            barycentric: random::square_to_triangle(random::unit2(random::hash(9, i, 0, 0))),
        })
        .collect();
    let outputs = [Output::Irradiance, Output::Harmonics { bands: 2 }];
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let lighting = Lighting::studio();
        pool.install(|| bake(&mesh, &paints, &lighting, &outputs, &points, 3, PathOptions::default()))
    };
    assert_eq!(run(1), run(5));
}

#[test]
fn surfaces_that_make_no_sense_leave_numbers() {
    let mesh = quads(&room(Vec3::ONE));
    let nonsense = [Vec3::NAN, Vec3::INFINITY, -Vec3::ONE];
    let paints =
        nonsense.map(|v| Paint { albedo: v, emission: v, transmission: Some(v), double_sided: false });
    let paints = Paints(paints.into_iter().cycle().take(6).collect());
    let points = [at(&mesh, 2, Vec3::new(0.2, -1.0, 0.4)), at(&mesh, 0, Vec3::new(-1.0, 0.2, 0.4))];
    let outputs = [Output::Irradiance, Output::Harmonics { bands: 3 }];
    let e = bake(&mesh, &paints, &Lighting::studio(), &outputs, &points, 20, PathOptions::default());
    assert!(e.means().iter().all(|v| v.is_finite()), "{:?}", e.means());
}

#[test]
fn nothing_at_all_is_dark() {
    let mesh = Mesh::new(vec![Vec3::ZERO; 3], vec![Vec3::ZERO; 3], vec![[0, 1, 2].map(VertexId)]).unwrap();
    let point = SurfacePoint { triangle: TriangleId(0), barycentric: [0.2, 0.2] };
    let lighting = Lighting::studio();
    let options = PathOptions::default();
    let e = bake(&mesh, &black(), &lighting, &[Output::Irradiance], &[point], 2, options);
    assert!(e.mean(0).iter().all(|&v| v == 0.0) && !e.valid(0));
    let mesh = quads(&[floor(1.0)]);
    let point = at(&mesh, 0, Vec3::ZERO);
    assert_eq!(irradiance(&mesh, &black(), &Lighting::default(), point, 3)[0], 0.0);
}
