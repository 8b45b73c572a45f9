//! Occlusion textures that a file has already, multiplied with what is baked (docs/PROFILES.md).
//!
//! They keep their own resolution where it is finer than ours: charts of such triangles have texels as wide as those of the
//! texture. Ours seldom needs them, so that few more rays are traced than for texels of one width: at the density of the bake,
//! on the same chart in a coarser grid, and again only where it is steep ([`OwnResolution::texels`]).
//!
//! How wide their texels are is found by island: triangles of one primitive that hang together in the texture too. Widths
//! are rounded down to steps, so that islands of about one width share charts. Where the largest page has no room for the
//! finest, these are cut to fewer steps, and their texels show means of what the texture has within them.

use glam::{DMat3, DVec2, DVec3, Vec2};
use lightkiln_chart::Chart;
use lightkiln_chart::pack::{MAX_PAGE, MAX_STACK, chart_texels};
use lightkiln_classify::regions;
use lightkiln_light::{Layer, Signal};
use lightkiln_mesh::{EdgeKind, SurfacePoint, TriangleId, VertexId};
use lightkiln_scene::{Slot, Textures};
use lightkiln_texel::fill::push_pull;
use lightkiln_texel::{ChartTexels, Footprint, StitchOptions, lift, lookup, stitch};
use rayon::prelude::*;

use crate::layers::Layers;
use crate::lighting::AuthoredOcclusion;
use crate::options::{CONFIDENCE, GUTTER_TEXELS, Plan};
use crate::rounds::TexelLight;
use crate::shade::Lit;
use crate::signals::{OCCLUSION_NAME, Stage};
use crate::{BakeError, Surface};

/// Steps of texel widths in a factor of two.
const STEPS: f64 = 8.0;

/// About as many texels of a texture are asked within a triangle at most.
const MOST_ASKED: f64 = 65536.0;

/// The occlusion textures of a file, as a factor.
pub struct Authored<'a> {
    surface: &'a Surface<'a>,
    textures: Textures<'a>,
    /// The channel that they are multiplied with.
    channel: usize,
}

impl<'a> Authored<'a> {
    /// Those of a scene for a signal, if both have what it takes.
    ///
    /// # Errors
    /// [`BakeError::Scene`] for images that cannot be read.
    pub fn of(surface: &'a Surface<'a>, signal: &dyn Signal) -> Result<Option<Self>, BakeError> {
        surface.scene.check_occlusion_textures()?;
        let mut first = 0;
        let mut scalar = None;
        for layer in signal.layers() {
            // That one shows the textures themselves.
            if layer.channels == 1 && layer.name != OCCLUSION_NAME {
                scalar = Some(first);
            }
            first += layer.channels;
        }
        let Some(channel) = scalar else { return Ok(None) };
        let textures = surface.scene.textures(Slot::Occlusion)?;
        Ok(textures.map(|textures| Self { surface, textures, channel }))
    }

    /// What they show at a point; 1 where there is none.
    fn factor(&self, point: SurfacePoint) -> f32 {
        let (part, triangle) = self.surface.part_of(point.triangle);
        let mut authored = [1.0];
        let shows = self.textures.sample(part, triangle, point.barycentric, &mut authored);
        if shows { authored[0] } else { 1.0 }
    }

    /// The mean of what they show over a texel of a chart, from some looks along each side of it.
    fn mean(&self, point: SurfacePoint, chart: &Chart, looks: u32) -> f32 {
        let corners = match chart.triangles.binary_search(&point.triangle) {
            Ok(local) if looks > 1 => chart.corners[local].map(|v| chart.uv[v as usize].as_dvec2()),
            // A point beyond the border of its chart, whose texel lies across others.
            _ => return self.factor(point),
        };
        let [b, c] = [corners[1] - corners[0], corners[2] - corners[0]];
        let area = b.perp_dot(c);
        if area == 0.0 {
            return self.factor(point);
        }
        let offset = |k: u32| (f64::from(k) + 0.5) / f64::from(looks) - 0.5;
        let [v, w] = point.barycentric;
        let at = |k: u32| {
            // Textures go on beyond the border of a triangle, as its neighbours show them or repeated.
            let p = DVec2::new(offset(k % looks), offset(k / looks));
            let barycentric = [v + (p.perp_dot(c) / area) as f32, w + (b.perp_dot(p) / area) as f32];
            self.factor(SurfacePoint { triangle: point.triangle, barycentric })
        };
        (0..looks * looks).map(at).sum::<f32>() / (looks * looks) as f32
    }

    /// Where the corners of a triangle lie in its image, in texels.
    fn corners(&self, triangle: TriangleId) -> Option<[DVec2; 3]> {
        let (part, local) = self.surface.part_of(triangle);
        let corners = self.textures.texel_corners(part, local)?;
        Some(corners.map(|corner| Vec2::from(corner).as_dvec2()))
    }

    /// What a texture shows at the centres of its texels within a triangle, with the barycentric coordinates of its second
    /// and third corner there; of some of them where they are very many.
    fn texels_in(&self, triangle: TriangleId) -> Vec<[f64; 3]> {
        let Some([a, b, c]) = self.corners(triangle) else { return Vec::new() };
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let (area, box_area) = ((b - a).perp_dot(c - a), (high - low).element_product());
        if area == 0.0 || !box_area.is_finite() {
            return Vec::new();
        }
        let stride = (box_area / MOST_ASKED).sqrt().ceil().max(1.0);
        let [columns, rows] = ((high - low) / stride).ceil().to_array().map(|n| n as u32);
        let first = (low - 0.5).ceil() + 0.5;
        let texel = |column: u32, row: u32| {
            let p = first + stride * DVec2::new(f64::from(column), f64::from(row));
            let (v, w) = ((p - a).perp_dot(c - a) / area, (b - a).perp_dot(p - a) / area);
            let point = SurfacePoint { triangle, barycentric: [v as f32, w as f32] };
            (v >= 0.0 && w >= 0.0 && v + w <= 1.0).then(|| [v, w, f64::from(self.factor(point))])
        };
        (0..=rows).flat_map(|row| (0..=columns).filter_map(move |column| texel(column, row))).collect()
    }

    /// Whether two triangles hang together in the texture across an edge.
    fn continues(&self, [triangle, next]: [TriangleId; 2], [edge, entry]: [usize; 2]) -> bool {
        let place = |triangle| {
            let (part, local) = self.surface.part_of(triangle);
            (part, self.surface.scene.parts[part].triangle_primitives[local])
        };
        let (Some(here), Some(there)) = (self.corners(triangle), self.corners(next)) else { return false };
        // Both run along the edge, in opposite directions.
        let near = |a: DVec2, b: DVec2| a.distance_squared(b) < 0.25;
        place(triangle) == place(next)
            && near(here[edge], there[(entry + 1) % 3])
            && near(here[(edge + 1) % 3], there[entry])
    }

    /// Per triangle, the steps by which texels must be finer than a width to be as fine as those of the texture: 0 where
    /// these are wider, or there are none.
    fn steps(&self, width: f32) -> Vec<u8> {
        let (mesh, adjacency) = (&self.surface.mesh, &self.surface.adjacency);
        let mut steps = vec![0; mesh.triangle_count()];
        let mut seen = vec![false; mesh.triangle_count()];
        let mut island = Vec::new();
        for start in mesh.triangle_ids() {
            if std::mem::replace(&mut seen[start.index()], true) {
                continue;
            }
            island.clear();
            island.push(start);
            let (mut area, mut texels, mut next) = (0.0, 0.0, 0);
            while let Some(&t) = island.get(next) {
                next += 1;
                let (part, local) = self.surface.part_of(t);
                area += mesh.area(t);
                texels += f64::from(self.textures.texels(part, local).unwrap_or(0.0));
                for edge in 0..3 {
                    let EdgeKind::Interior { triangle, edge: entry } = adjacency.across(t, edge) else {
                        continue;
                    };
                    if !seen[triangle.index()] && self.continues([t, triangle], [edge, usize::from(entry)]) {
                        seen[triangle.index()] = true;
                        island.push(triangle);
                    }
                }
            }
            if area > 0.0 && texels > 0.0 {
                let finer = (f64::from(width) / (area / texels).sqrt()).log2();
                // As good as none where rounding alone makes them finer.
                let own = (STEPS * finer - 1e-3).ceil().clamp(0.0, f64::from(u8::MAX)) as u8;
                island.iter().for_each(|t| steps[t.index()] = own);
            }
        }
        steps
    }
}

/// A signal one channel of which is multiplied with what occlusion textures show.
pub struct TimesAuthored<'a> {
    signal: Box<dyn Signal + 'a>,
    authored: Authored<'a>,
}

impl<'a> TimesAuthored<'a> {
    /// The signal itself where there is nothing to multiply it with.
    ///
    /// # Errors
    /// Those of [`Authored::of`].
    pub fn on(
        signal: Box<dyn Signal + 'a>,
        surface: &'a Surface<'a>,
    ) -> Result<Box<dyn Signal + 'a>, BakeError> {
        Ok(match Authored::of(surface, signal.as_ref())? {
            Some(authored) => Box::new(Self { signal, authored }),
            None => signal,
        })
    }
}

impl Signal for TimesAuthored<'_> {
    fn layers(&self) -> &[Layer] {
        self.signal.layers()
    }

    fn rays_per_batch(&self) -> u32 {
        self.signal.rays_per_batch()
    }

    fn batch(&self, point: SurfacePoint, key: u64, batch: u32, out: &mut [f32]) -> f32 {
        let backs = self.signal.batch(point, key, batch, out);
        out[self.authored.channel] *= self.authored.factor(point);
        backs
    }
}

/// What gives charts the texels of occlusion textures that are finer than those of a bake.
pub struct OwnResolution<'a> {
    authored: Authored<'a>,
    /// What is traced, without the textures.
    pub signal: Box<dyn Signal + 'a>,
    /// Per triangle.
    steps: Vec<u8>,
}

/// How much finer than a width texels are that are finer by some steps.
pub fn finer(steps: u8) -> f64 {
    (f64::from(steps) / STEPS).exp2()
}

impl<'a> OwnResolution<'a> {
    /// For a bake whose light is ours times theirs, where theirs is finer anywhere.
    ///
    /// # Errors
    /// Those of the signals.
    pub fn of(plan: &Plan, stage: &Stage<'a>) -> Result<Option<Self>, BakeError> {
        if plan.light.authored_occlusion != Some(AuthoredOcclusion::Multiply) {
            return Ok(None);
        }
        let signal = plan.signals.unmultiplied_on(stage)?;
        let Some(authored) = Authored::of(stage.surface, signal.as_ref())? else { return Ok(None) };
        let steps = authored.steps(plan.radius);
        let any = steps.iter().any(|&s| s > 0);
        Ok(any.then_some(Self { authored, signal, steps }))
    }

    /// Triangles become texture triangles where vertices cannot carry what their texture has between samples.
    ///
    /// Triangles with fewer samples than texels of the texture ask the texels, too. Whatever three vertices show is off by
    /// about as much as the linear function of least squares through these, times what ours is there on the average.
    /// Elsewhere the samples have said all there is, and finer geometry than texels carries ours better than texels do.
    pub fn promote(&self, lit: &mut Lit, max_error: f32) {
        let (mesh, channels) = (&self.authored.surface.mesh, lit.layers.channels());
        let Lit { needs_texture, samples, layers, values, .. } = lit;
        let channel = self.authored.channel;
        let product = |v: &VertexId| layers.from_unit(channel, values[v.index() * channels + channel]);
        needs_texture.par_iter_mut().enumerate().for_each(|(t, needs)| {
            let triangle = TriangleId(t as u32);
            if *needs || self.steps[t] == 0 {
                return;
            }
            let texels = self.authored.texels_in(triangle);
            if texels.len() <= samples.of_triangle(triangle).len() {
                return;
            }
            let mean = texels.iter().map(|[.., x]| x).sum::<f64>() / texels.len() as f64;
            let shown = mesh.triangles[t].iter().map(|v| f64::from(product(v))).sum::<f64>() / 3.0;
            let ours = if mean > shown { shown / mean } else { 1.0 };
            *needs = ours * off_linear(&texels) > f64::from(max_error);
        });
    }

    /// The largest number of steps.
    pub fn most_steps(&self) -> u8 {
        self.steps.iter().copied().max().unwrap_or_default()
    }

    /// The steps of a triangle.
    pub fn steps(&self, triangle: TriangleId) -> u8 {
        self.steps[triangle.index()]
    }

    /// What steps must be cut to at least for texture triangles to fit into an atlas, by their areas alone.
    ///
    /// - `most`: what they are cut to already
    /// - `width`: of a texel of the bake
    pub fn affordable_steps(&self, is_texture: &[bool], most: u8, width: f32) -> u8 {
        let mesh = &self.authored.surface.mesh;
        let mut area = vec![0.0; usize::from(most) + 1];
        for t in mesh.triangle_ids().filter(|t| is_texture[t.index()]) {
            area[usize::from(self.steps(t).min(most))] += mesh.area(t) / f64::from(width).powi(2);
        }
        let texels = |cut: u8| -> f64 {
            (0..=most).zip(&area).map(|(steps, area)| area * finer(steps.min(cut)).powi(2)).sum()
        };
        let room = f64::from(MAX_PAGE) * f64::from(MAX_STACK);
        (1..=most).rev().find(|&cut| texels(cut) <= room).unwrap_or(0)
    }

    /// Connected texture triangles whose texels are of one width, those of the widest texels first.
    ///
    /// - `most`: what finer ones are cut to
    pub fn regions(&self, is_texture: &[bool], most: u8) -> Vec<(u8, Vec<TriangleId>)> {
        let of_steps = |steps: u8| {
            let of_width: Vec<bool> =
                is_texture.iter().zip(&self.steps).map(|(&t, &own)| t && own.min(most) == steps).collect();
            let regions = regions(&self.authored.surface.adjacency, &of_width);
            regions.into_iter().map(move |region| (steps, region))
        };
        let has = |steps: &u8| self.steps.iter().any(|own| own.min(&most) == steps);
        (0..=most).filter(has).flat_map(of_steps).collect()
    }

    /// The light of charts whose texels are finer by some steps: ours times theirs. Ours is interpolated between texels of
    /// the width of the bake, whose borders are stitched, and traced where these differ by more than bound and noise.
    ///
    /// - `light`: lights the texels of charts that have a lift
    ///
    /// # Errors
    /// Those of `light`, and [`BakeError::Texel`].
    pub fn texels(
        &self,
        charts: &[Chart],
        steps: u8,
        layers: &Layers,
        plan: &Plan,
        mut light: impl FnMut(&[ChartTexels]) -> Result<Vec<TexelLight>, BakeError>,
    ) -> Result<(Vec<ChartTexels>, Vec<TexelLight>), BakeError> {
        let surface = self.authored.surface;
        let (mesh, adjacency) = (&surface.mesh, &surface.adjacency);
        let factor = finer(steps).recip() as f32;
        let (channel, channels) = (self.authored.channel, layers.channels());
        let (coarse, shifts): (Vec<Chart>, Vec<Vec2>) =
            charts.par_iter().map(|chart| chart.scaled(factor, GUTTER_TEXELS)).unzip();
        let of_coarse = lift(mesh, adjacency, &coarse, plan.seed);
        let mut of_bake = light(&of_coarse)?;
        of_bake.iter_mut().zip(&of_coarse).for_each(|(light, texels)| light.keep_hidden(texels));
        let texels = lift(mesh, adjacency, charts, plan.seed);
        // Where the texels lie in the coarser grid. Where the surface ends, the point that is shown is not the centre.
        let places = |c: usize| {
            let (own, shift) = (&texels[c], shifts[c]);
            let mut outside = own.outside.iter().peekable();
            (0..own.len() as u32).map(move |texel| {
                let beyond = outside.next_if(|o| o.texel == texel).map(|o| o.at);
                beyond.unwrap_or_else(|| own.centre(texel)) * factor + shift
            })
        };
        let steep = texels.par_iter().enumerate().map(|(c, own)| {
            let is_steep = |at| self.is_steep(coarse[c].size, &of_bake[c], at, channels, plan.max_error);
            let lifts = own.lift.iter().zip(places(c));
            let lift = lifts.map(|(lift, at)| lift.filter(|_| is_steep(at))).collect();
            ChartTexels { size: own.size, lift, keys: own.keys.clone(), outside: Vec::new() }
        });
        let of_steep = light(&steep.collect::<Vec<_>>())?;
        let (mut values, mut valid, mut variances) = (Vec::new(), Vec::new(), Vec::new());
        let mut traced = Vec::new();
        for own in of_bake {
            values.push(own.values);
            valid.push(own.valid);
            variances.push(own.variances);
            traced.push((own.shaded, own.rays));
        }
        let options = StitchOptions {
            valid: Some(&valid),
            variances: Some(&variances),
            range: [0.0, 1.0],
            ..StitchOptions::default()
        };
        stitch(mesh, &coarse, &of_coarse, &mut values, channels, &options)?;
        // What no lookup within a chart reads may be read from a texel beyond its border.
        let sets = of_coarse.par_iter().zip(values.par_iter_mut().zip(&mut variances));
        sets.for_each(|(texels, (values, variances))| {
            let covered: Vec<bool> = texels.lift.iter().map(Option::is_some).collect();
            push_pull(texels.size, channels, values, &covered);
            push_pull(texels.size, 1, variances, &covered);
        });
        let finer = of_steep.into_par_iter().enumerate().map(|(c, mut light)| {
            light.shaded += traced[c].0;
            light.rays += traced[c].1;
            for (texel, at) in places(c).enumerate() {
                let Some(point) = texels[c].lift[texel] else { continue };
                let shown = &mut light.values[texel * channels..][..channels];
                if !light.valid[texel] {
                    lookup(coarse[c].size, channels, &values[c], at, shown);
                    lookup(coarse[c].size, 1, &variances[c], at, &mut light.variances[texel..=texel]);
                }
                let authored = self.authored.mean(point, &charts[c], self.looks(point.triangle, steps));
                let product = layers.from_unit(channel, shown[channel]) * authored;
                shown[channel] = layers.to_unit(channel, product);
                light.variances[texel] *= authored * authored;
                light.valid[texel] = true;
            }
            light
        });
        let finer = finer.collect();
        Ok((texels, finer))
    }

    /// Whether ours changes by more than a bound and its noise between the texels around a place.
    fn is_steep(&self, size: [u32; 2], light: &TexelLight, at: Vec2, channels: usize, bound: f32) -> bool {
        let (mut low, mut high, mut variance) = (f32::INFINITY, f32::NEG_INFINITY, 0.0_f32);
        for texel in
            Footprint::new(size, at).texels.map(|t| t as usize).into_iter().filter(|&t| light.valid[t])
        {
            let value = light.values[texel * channels + self.authored.channel];
            (low, high) = (low.min(value), high.max(value));
            variance = variance.max(light.variances[texel]);
        }
        high - low > bound + CONFIDENCE * (2.0 * variance).sqrt()
    }

    /// Along each side of a texel that is finer by some steps: as many looks as it has texels of the texture, up to
    /// [`MOST_LOOKS_ALONG`].
    fn looks(&self, triangle: TriangleId, steps: u8) -> u32 {
        let along = finer(self.steps(triangle).saturating_sub(steps));
        (along.ceil() as u32).min(MOST_LOOKS_ALONG)
    }

    /// What is worth a word once charts are packed: textures whose texels had to be made wider after all.
    pub fn remark(&self, charts: &[Chart], plan: &Plan) -> Option<String> {
        // Area, texels as fine as theirs, and texels, by steps.
        let mut of_steps = vec![[0.0; 3]; usize::from(self.most_steps()) + 1];
        for chart in charts {
            let steps = self.steps(chart.triangles[0]);
            let area: f64 = chart.triangles.iter().map(|&t| self.authored.surface.mesh.area(t)).sum();
            let theirs = area * (finer(steps) / f64::from(plan.radius)).powi(2);
            let sums = [area, theirs, chart_texels(std::slice::from_ref(chart))];
            of_steps[usize::from(steps)].iter_mut().zip(sums).for_each(|(sum, own)| *sum += own);
        }
        let lost = of_steps[1..].iter().filter(|[_, theirs, ours]| *ours < LOST_SHARE * theirs);
        let [area, theirs, ours] = lost.fold([0.0; 3], |sum, own| std::array::from_fn(|k| sum[k] + own[k]));
        (area > 0.0).then(|| {
            format!(
                "the occlusion textures of the file have texels of {:.5} where the largest page has room for texels of \
                 {:.5}: detail between them is lost where the errors below say so; --authored-occlusion keep leaves these \
                 materials alone",
                (area / theirs).sqrt(),
                (area / ours).sqrt()
            )
        })
    }
}

/// Looks along a side of a texel at most: more take long and change its mean by little.
const MOST_LOOKS_ALONG: u32 = 2;

/// Texels count as wider than those of the textures when there are fewer than this share of them.
const LOST_SHARE: f64 = 0.8;

/// The largest difference of values (the third numbers) from the linear function of the first two that is nearest to them in
/// the sense of least squares.
fn off_linear(points: &[[f64; 3]]) -> f64 {
    let basis = |p: &[f64; 3]| DVec3::new(1.0, p[0], p[1]);
    let (mut matrix, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for p in points {
        let b = basis(p);
        matrix += DMat3::from_cols(b * b.x, b * b.y, b * b.z);
        right += b * p[2];
    }
    // Where all points lie on one line, the function is level across it.
    let ridge = 1e-9 * matrix.x_axis.x;
    matrix.y_axis.y += ridge;
    matrix.z_axis.z += ridge;
    let plane = matrix.inverse() * right;
    let off = points.iter().map(|p| (plane.dot(basis(p)) - p[2]).abs()).fold(0.0, f64::max);
    if off.is_finite() { off } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn off_linear_of_linear_values_is_nothing() {
        let grid = || (0..5).flat_map(|v| (0..5 - v).map(move |w| [f64::from(v) / 4.0, f64::from(w) / 4.0]));
        let of = |value: &dyn Fn(f64, f64) -> f64| {
            off_linear(&grid().map(|[v, w]| [v, w, value(v, w)]).collect::<Vec<_>>())
        };
        assert!(of(&|v, w| 0.2 + 0.5 * v - 0.3 * w) < 1e-6);
        assert!(of(&|v, w| if v > 0.9 || w > 0.9 { 0.0 } else { 1.0 }) > 0.3);
        // Along one line, and of nothing.
        assert!(off_linear(&[[0.0, 0.0, 0.1], [0.5, 0.0, 0.3], [1.0, 0.0, 0.5]]) < 1e-6);
        assert!(off_linear(&[]) == 0.0);
    }

    #[test]
    fn finer_doubles_with_the_steps_of_a_factor_of_two() {
        assert_eq!([0, STEPS as u8, 2 * STEPS as u8].map(finer), [1.0, 2.0, 4.0]);
    }
}
