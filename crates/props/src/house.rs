//! A cottage in its garden: large walls beside fine leaves, what Schaefer's forest scene asks of a bake.
//!
//! Where plants stand is decided by hashes of their numbers, not by size: a larger scene is the same scene, finer.

use std::f64::consts::TAU;

use glam::{DQuat, DVec3, Quat};

use crate::model::{Assembly, Material, MaterialId, MeshId, NodeId, Place, Surface};
use crate::shapes::{
    Detail, bent, cuboid, curve, lathe, panel, patch, rounded_box, tube, wall, with_triangles,
};

/// A number in `0..1` for each pair.
fn chance(what: u64, which: u64) -> f64 {
    // The finalizer of splitmix64 (Steele, Lea and Flood 2014).
    let mut x = (what << 32 | which).wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((x ^ (x >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

fn smooth(from: f64, to: f64, x: f64) -> f64 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// The ground's height: level below the house, rolling around it.
fn ground(x: f64, z: f64) -> f64 {
    let hills = 0.35 * (0.6 * x + 0.4).sin() * (0.5 * z).cos() + 0.12 * (1.7 * x - 0.8 * z).sin();
    hills * smooth(3.2, 5.5, x.hypot(z))
}

/// A house of about `triangles` triangles with its garden, counted as drawn: plants are instances.
pub fn house(triangles: usize) -> Assembly {
    with_triangles(triangles, |detail| {
        let mut garden = Garden::new(*detail);
        garden.cottage();
        garden.fence();
        garden.plants();
        garden.scene
    })
}

struct Garden {
    scene: Assembly,
    detail: Detail,
    root: NodeId,
    plaster: MaterialId,
    wood: MaterialId,
    tile: MaterialId,
    stone: MaterialId,
    bark: MaterialId,
    leaf: MaterialId,
    red: MaterialId,
}

impl Garden {
    fn new(detail: Detail) -> Self {
        let mut scene = Assembly::default();
        let root = scene.node("house", None, None, Place::default());
        let mut add = |name, color| scene.material(Material::matte(name, color));
        let plaster = add("plaster", [0.78, 0.74, 0.66]);
        let wood = add("wood", [0.35, 0.22, 0.12]);
        let tile = add("tile", [0.45, 0.14, 0.08]);
        let stone = add("stone", [0.42, 0.41, 0.38]);
        let bark = add("bark", [0.2, 0.13, 0.08]);
        let red = add("red", [0.6, 0.05, 0.03]);
        let grass = add("grass", [0.16, 0.26, 0.07]);
        let mut leaf = Material::matte("leaf", [0.12, 0.3, 0.06]);
        leaf.double_sided = true;
        let leaf = scene.material(leaf);
        let size = 16.0;
        let earth = patch(&detail, [40, 40], &|u, v| {
            let (x, z) = ((v - 0.5) * size, (u - 0.5) * size);
            DVec3::new(x, ground(x, z), z)
        });
        scene.part("ground", earth, grass, Some(root));
        Self { scene, detail, root, plaster, wood, tile, stone, bark, leaf, red }
    }

    fn part(&mut self, name: &str, surface: Surface, material: MaterialId) {
        self.scene.part(name, surface, material, Some(self.root));
    }

    fn bar(&self, low: [f64; 3], high: [f64; 3]) -> Surface {
        let (low, high) = (DVec3::from_array(low), DVec3::from_array(high));
        let steps = (high - low).to_array().map(|length| self.detail.steps(length, 1));
        let count = 4 * (steps[0] * steps[1] + steps[1] * steps[2] + steps[2] * steps[0]);
        if self.detail.only_count {
            return Surface { count, ..Surface::default() };
        }
        cuboid(low, high, steps)
    }

    /// Walls of 4 x 3 metres with door and windows, a gable roof of tiles, a chimney, steps.
    fn cottage(&mut self) {
        let detail = self.detail;
        let (width, depth, high, thick) = (4.0, 3.0, 2.2, 0.22);
        let (x, z) = (0.5 * width, 0.5 * depth);
        let plinth = self.bar([-x - 0.06, -0.3, -z - 0.06], [x + 0.06, 0.18, z + 0.06]);
        self.part("plinth", plinth, self.stone);
        let front = [[0.5, 0.85, 1.2, 1.75], [1.7, 0.0, 2.45, 1.9], [2.95, 0.85, 3.6, 1.75]];
        let back = [[0.8, 0.85, 1.7, 1.75]];
        let side = [[0.9, 0.85, 1.7, 1.75]];
        let quarter = Quat::from_rotation_y(std::f32::consts::FRAC_PI_2);
        let half = Quat::from_rotation_y(std::f32::consts::PI);
        let inner = depth - 2.0 * thick;
        for (name, openings, length, turn, at) in [
            ("front_wall", &front[..], width, Quat::IDENTITY, DVec3::new(-x, 0.18, z)),
            ("back_wall", &back[..], width, half, DVec3::new(x, 0.18, -z)),
            ("right_wall", &side[..], inner, quarter, DVec3::new(x, 0.18, z - thick)),
            ("left_wall", &side[..], inner, quarter.inverse(), DVec3::new(-x, 0.18, -z + thick)),
        ] {
            let shape = wall(&detail, [length, high], thick, openings).turned(turn).moved(at);
            self.part(name, shape, self.plaster);
        }
        for (k, o) in front.iter().enumerate() {
            let (left, right, z) = (o[0] - x, o[2] - x, z - 0.12);
            let (low, high) = (o[1] + 0.18, o[3] + 0.18);
            if k == 1 {
                let boards = (0..6).map(|i| {
                    let at = |i: f64| left + (right - left) * i / 6.0;
                    let (from, to) = (at(f64::from(i)) + 0.004, at(f64::from(i) + 1.0) - 0.004);
                    self.bar([from, low + 0.01, z - 0.04], [to, high - 0.01, z])
                });
                let door = boards.fold(Surface::default(), Surface::and);
                self.part("door", door, self.wood);
                continue;
            }
            let middle = 0.5 * (left + right);
            let across = 0.5 * (low + high);
            let frame = self
                .bar([left, low, z - 0.05], [right, low + 0.05, z])
                .and(self.bar([left, high - 0.05, z - 0.05], [right, high, z]))
                .and(self.bar([left, low + 0.05, z - 0.05], [left + 0.05, high - 0.05, z]))
                .and(self.bar([right - 0.05, low + 0.05, z - 0.05], [right, high - 0.05, z]))
                .and(
                    self.bar([middle - 0.015, low + 0.05, z - 0.04], [middle + 0.015, high - 0.05, z - 0.01]),
                )
                .and(self.bar(
                    [left + 0.05, across - 0.015, z - 0.039],
                    [right - 0.05, across + 0.015, z - 0.011],
                ));
            self.part(&format!("window_{k}"), frame, self.wood);
            let shutter = self.bar([left - 0.36, low, z + 0.13], [left - 0.02, high, z + 0.16]);
            let other = self.bar([right + 0.02, low, z + 0.13], [right + 0.36, high, z + 0.16]);
            self.part(&format!("shutters_{k}"), shutter.and(other), self.red);
        }
        // Gables of planks that overlap, and tiles in rows above.
        let (eaves, rise) = (high + 0.18, 1.5);
        let planks = 12;
        for sign in [1.0, -1.0] {
            let mut gable = Surface::default();
            for k in 0..planks {
                let (from, to) = (f64::from(k) / f64::from(planks), f64::from(k + 1) / f64::from(planks));
                let reach = (z - 0.02) * (1.0 - from);
                let (near, far) = (x - 0.16, x - 0.11 + 0.02 * (from - to));
                let (low, high) =
                    (if sign > 0.0 { near } else { -far }, if sign > 0.0 { far } else { -near });
                gable.append(self.bar([low, eaves + rise * from, -reach], [high, eaves + rise * to, reach]));
            }
            self.part(if sign > 0.0 { "right_gable" } else { "left_gable" }, gable, self.wood);
        }
        for sign in [1.0, -1.0] {
            let roof = panel(&detail, [48, 30], 0.05, &|u, v| {
                let down = 1.25 * (1.0 - v);
                let row = (down * 9.0).fract();
                let lift =
                    0.1 + 0.015 * (1.0 - row) * smooth(0.0, 0.4, row) + 0.012 * (TAU * 7.0 * u).sin().powi(2);
                DVec3::new(
                    (u - 0.5) * (width + 0.5) * sign,
                    eaves + rise * (1.0 - down) + lift,
                    sign * z * down,
                )
            });
            self.part(if sign > 0.0 { "front_roof" } else { "back_roof" }, roof, self.tile);
        }
        let chimney = self
            .bar([0.9, eaves + 0.4, -0.75], [1.35, eaves + 2.0, -0.3])
            .and(self.bar([0.84, eaves + 2.0, -0.81], [1.41, eaves + 2.12, -0.24]));
        self.part("chimney", chimney, self.stone);
        for k in 0..3 {
            let (reach, high) = (0.3 * f64::from(3 - k), 0.06 * f64::from(k + 1));
            let step = self.bar([-0.5, -0.2, z + 0.06], [0.6, high, z + 0.06 + reach]);
            self.part(&format!("step_{k}"), step, self.stone);
        }
        let barrel: [&[(f64, f64)]; 5] = [
            &[(0.0, 0.0), (0.26, 0.0)],
            &[(0.26, 0.0), (0.32, 0.4), (0.27, 0.82)],
            &[(0.27, 0.82), (0.24, 0.82)],
            &[(0.24, 0.82), (0.28, 0.4), (0.23, 0.06)],
            &[(0.23, 0.06), (0.0, 0.06)],
        ];
        let barrel = lathe(&detail, 24, &barrel).upright().moved(DVec3::new(2.45, 0.0, 1.0));
        self.part("barrel", barrel, self.wood);
    }

    /// Pickets around the garden, with a gap before the door.
    fn fence(&mut self) {
        let picket = self.bar([-0.04, -0.1, -0.011], [0.04, 0.75, 0.011]);
        let picket = self.scene.mesh("picket", picket, self.wood);
        let rail = self.bar([-0.7, -0.03, -0.04], [0.7, 0.03, -0.012]);
        let rail = self.scene.mesh("rail", rail, self.wood);
        let post = self.bar([-0.05, -0.3, -0.14], [0.05, 0.85, -0.041]);
        let post = self.scene.mesh("post", post, self.wood);
        let reach = 6.3;
        let group = self.scene.node("fence", None, Some(self.root), Place::default());
        for side in 0..4 {
            let turn = Quat::from_rotation_y(side as f32 * std::f32::consts::FRAC_PI_2);
            for k in 0..9 {
                if side == 0 && k == 4 {
                    continue;
                }
                let along = (f64::from(k) - 4.0) * 1.4;
                let at = turn * DVec3::new(along, 0.0, reach).as_vec3();
                let high = ground(f64::from(at.x), f64::from(at.z)) as f32;
                let place = Place { rotation: turn, ..Place::at(at.x, high, at.z) };
                let name = format!("fence_{side}_{k}");
                let panel = self.scene.node(&name, None, Some(group), place);
                for (j, height) in [0.2, 0.55].into_iter().enumerate() {
                    self.scene.node(
                        format!("{name}_rail_{j}"),
                        Some(rail),
                        Some(panel),
                        Place::at(0.0, height, 0.0),
                    );
                }
                self.scene.node(format!("{name}_post"), Some(post), Some(panel), Place::at(-0.7, 0.0, 0.0));
                for i in 0..8 {
                    let place = Place::at((i as f32 - 3.5) * 0.17, 0.0, 0.0);
                    self.scene.node(format!("{name}_picket_{i}"), Some(picket), Some(panel), place);
                }
            }
        }
    }

    /// Trees, bushes, ferns, mushrooms and stones between house and fence.
    fn plants(&mut self) {
        let trees = [self.broad_tree(0), self.broad_tree(1), self.fir()];
        for (k, (x, z, kind, scale)) in [
            (-4.4, 2.2, 0, 1.0),
            (4.3, -2.6, 1, 1.1),
            (-3.6, -4.4, 2, 1.0),
            (4.8, 3.4, 2, 0.8),
            (0.8, -4.9, 0, 0.9),
            (-5.3, -1.4, 1, 0.75),
        ]
        .into_iter()
        .enumerate()
        {
            let rotation = Quat::from_rotation_y((TAU * chance(1, k as u64)) as f32);
            let at = Place::at(x, ground(f64::from(x), f64::from(z)) as f32 - 0.05, z);
            let place = Place { rotation, scale: glam::Vec3::splat(scale), ..at };
            let tree = self.scene.node(format!("tree_{k}"), None, Some(self.root), place);
            for (i, mesh) in trees[kind].iter().enumerate() {
                self.scene.node(format!("tree_{k}_{i}"), Some(*mesh), Some(tree), Place::default());
            }
        }
        let stone = self.puff(2, 0.16, 0.35);
        let stone = self.scene.mesh("stone", stone, self.stone);
        let bush = self.puff(3, 0.4, 0.5);
        let bush = self.scene.mesh("bush", bush, self.leaf);
        let fern = self.fern();
        let mushroom = self.mushroom();
        for (kind, count, (near, far)) in [
            ("stone", 14, (2.9, 5.8)),
            ("bush", 9, (2.9, 5.6)),
            ("fern", 26, (2.9, 6.0)),
            ("mushroom", 12, (3.2, 5.8)),
        ] {
            let what = kind.len() as u64;
            for k in 0..count {
                let angle = TAU * (f64::from(k) + 0.7 * chance(what, 4 * k as u64)) / f64::from(count);
                let far_out = near + (far - near) * chance(what, 4 * k as u64 + 1);
                let (x, z) = (far_out * angle.sin(), far_out * angle.cos());
                let turn = Quat::from_rotation_y((TAU * chance(what, 4 * k as u64 + 2)) as f32);
                let scale = glam::Vec3::splat(0.6 + 0.8 * chance(what, 4 * k as u64 + 3) as f32);
                let place =
                    Place { rotation: turn, scale, ..Place::at(x as f32, ground(x, z) as f32, z as f32) };
                let meshes: &[MeshId] = match kind {
                    "stone" => &[stone],
                    "bush" => &[bush],
                    "fern" => &[fern],
                    _ => &mushroom,
                };
                let node = self.scene.node(format!("{kind}_{k}"), None, Some(self.root), place);
                for (i, mesh) in meshes.iter().enumerate() {
                    self.scene.node(format!("{kind}_{k}_{i}"), Some(*mesh), Some(node), Place::default());
                }
            }
        }
    }

    /// A bumpy ball around the origin.
    fn puff(&self, what: u64, radius: f64, roughness: f64) -> Surface {
        let waves: Vec<(DVec3, f64)> = (0..6)
            .map(|k| {
                let c = |i: u64| 2.0 * chance(what, 8 * k + i) - 1.0;
                (DVec3::new(c(0), c(1), c(2)) * (2.0 + k as f64) / radius, TAU * c(3))
            })
            .collect();
        bent(rounded_box(&self.detail, DVec3::splat(radius), 0.9 * radius, 6), |p, n| {
            let bumps: f64 = waves.iter().map(|(w, phase)| (w.dot(p) + phase).sin()).sum::<f64>() / 6.0;
            p + n * roughness * radius * bumps
        })
    }

    /// Trunk and branches, and the leaves as one crown of bumpy balls with single leaves around it.
    fn broad_tree(&mut self, kind: u64) -> Vec<MeshId> {
        let detail = self.detail;
        let what = 20 + kind;
        let trunk = [[0.0, 0.0, 0.0], [0.06, 0.6, 0.03], [-0.05, 1.3, 0.05], [0.02, 2.1, -0.04]]
            .map(DVec3::from_array);
        let mut wood = tube(&detail, [10, 10], 0.11, false, &|t| curve(&trunk, t));
        let mut crown = self.puff(what, 0.75, 0.45).moved(DVec3::new(0.0, 2.6, 0.0));
        for k in 0..6 {
            let c = |i: u64| chance(what, 100 + 8 * k + i);
            let angle = TAU * (k as f64 + 0.6 * c(0)) / 6.0;
            let (from, reach) = (curve(&trunk, 0.6 + 0.06 * k as f64), 0.75 + 0.35 * c(1));
            let tip = from + DVec3::new(reach * angle.sin(), 0.45 + 0.35 * c(2), reach * angle.cos());
            let middle = from.lerp(tip, 0.5) - DVec3::Y * 0.08;
            wood.append(tube(&detail, [6, 7], 0.04, false, &|t| curve(&[from, middle, tip], t)));
            crown.append(self.puff(what + 10 + k, 0.38 + 0.12 * c(3), 0.5).moved(tip));
        }
        let mut leaves = Surface::default();
        for k in 0..160 {
            let c = |i: u64| chance(what, 1000 + 8 * k + i);
            let (height, angle) = (2.0 * c(0) - 0.8, TAU * c(1));
            let ring = (1.0 - height.min(1.0) * height.min(1.0)).max(0.0).sqrt();
            let way = DVec3::new(ring * angle.sin(), height, ring * angle.cos()).normalize();
            let at = DVec3::new(0.0, 2.6, 0.0) + way * DVec3::new(1.15, 0.8, 1.15) * (0.95 + 0.2 * c(2));
            leaves.append(self.blade(at, way, TAU * c(3), 0.16 + 0.06 * c(4), 0.09));
        }
        let name = ["oak", "apple"][kind as usize % 2];
        vec![
            self.scene.mesh(format!("{name}_wood"), wood, self.bark),
            self.scene.mesh(format!("{name}_crown"), crown, self.leaf),
            self.scene.mesh(format!("{name}_leaves"), leaves, self.leaf),
        ]
    }

    /// One leaf as an open sheet, arched along its length.
    fn blade(&self, at: DVec3, way: DVec3, spin: f64, length: f64, width: f64) -> Surface {
        let side = DQuat::from_axis_angle(way, spin) * way.any_orthonormal_vector();
        let up = side.cross(way);
        patch(&self.detail, [2, 4], &|u, v| {
            let bulge = (std::f64::consts::PI * (0.08 + 0.9 * v)).sin();
            at + way * (length * v) + side * (width * (u - 0.5) * bulge) + up * (0.5 * length * v * (1.0 - v))
        })
    }

    /// A trunk and seven skirts of twigs.
    fn fir(&mut self) -> Vec<MeshId> {
        let detail = self.detail;
        let trunk: [&[(f64, f64)]; 3] =
            [&[(0.0, 0.0), (0.1, 0.0)], &[(0.1, 0.0), (0.03, 3.0)], &[(0.03, 3.0), (0.0, 3.0)]];
        let trunk = lathe(&detail, 10, &trunk).upright();
        let mut skirts = Surface::default();
        for k in 0..7 {
            let low = 0.55 + 0.36 * f64::from(k);
            let reach = 0.95 - 0.115 * f64::from(k);
            let below: &[(f64, f64)] = &[(0.0, low), (0.5 * reach, low), (reach, low)];
            let above: &[(f64, f64)] = &[(reach, low), (0.5 * reach, low + 0.28), (0.0, low + 0.55)];
            // Each bent by itself: a crease stays between them.
            for span in [below, above] {
                skirts.append(bent(lathe(&detail, 40, &[span]).upright(), |p, _| {
                    let angle = p.x.atan2(p.z) + f64::from(k);
                    let ripple = 1.0 + 0.12 * p.x.hypot(p.z) / reach * (5.0 * angle).sin();
                    DVec3::new(p.x * ripple, p.y, p.z * ripple)
                }));
            }
        }
        vec![self.scene.mesh("fir_trunk", trunk, self.bark), self.scene.mesh("fir_twigs", skirts, self.leaf)]
    }

    /// A tuft of arching blades.
    fn fern(&mut self) -> MeshId {
        let mut tuft = Surface::default();
        for k in 0..14 {
            let c = |i: u64| chance(40, 8 * k + i);
            let angle = TAU * (k as f64 + 0.5 * c(0)) / 14.0;
            let lean = 0.5 + 0.6 * c(1);
            let way = DVec3::new(lean * angle.sin(), 1.0, lean * angle.cos()).normalize();
            let side = DVec3::new(angle.cos(), 0.0, -angle.sin());
            let (length, width) = (0.32 + 0.16 * c(2), 0.05 + 0.02 * c(3));
            let foot = DVec3::new(0.02 * angle.sin(), -0.02, 0.02 * angle.cos());
            // Its front looks up.
            let blade = patch(&self.detail, [2, 8], &|u, v| {
                let bulge = 0.15 + (std::f64::consts::PI * (0.15 + 0.8 * v)).sin();
                let out = foot + way * (length * v) + side * (width * (u - 0.5) * bulge);
                out + DVec3::new(angle.sin(), -0.9, angle.cos()) * (0.35 * length * v * v)
            });
            tuft.append(blade.flipped());
        }
        self.scene.mesh("fern", tuft, self.leaf)
    }

    fn mushroom(&mut self) -> [MeshId; 2] {
        let stem: &[(f64, f64)] = &[(0.0, -0.05), (0.045, -0.03), (0.032, 0.08), (0.028, 0.2), (0.0, 0.205)];
        let stem = lathe(&self.detail, 12, &[stem]).upright();
        let cap: [&[(f64, f64)]; 2] = [
            &[(0.0, 0.19), (0.08, 0.185), (0.14, 0.16)],
            &[(0.14, 0.16), (0.13, 0.21), (0.08, 0.27), (0.0, 0.295)],
        ];
        let cap = lathe(&self.detail, 18, &cap).upright();
        [self.scene.mesh("mushroom_stem", stem, self.plaster), self.scene.mesh("mushroom_cap", cap, self.red)]
    }
}
