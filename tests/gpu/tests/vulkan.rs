//! The WGSL of `shaders/` on a Vulkan driver against the CPU twin: every program, within one step of 8 bits.
//!
//! Any driver will do, that of a GPU or Mesa's lavapipe; without one the test fails. `VK_DRIVER_FILES` chooses.

#![allow(clippy::print_stderr)] // which driver it was, and how far each program is off

use std::collections::BTreeMap;
use std::error::Error;
use std::sync::mpsc;

use lightkiln_gpu::{Atlas, BOUND, Case, PAGES, PIXELS, Program, SIZE, Textures, cases};
use wgpu::util::{BufferInitDescriptor, DeviceExt, TextureDataOrder};

const WGSL: &str = concat!(
    include_str!("../../../shaders/lightkiln.wgsl"),
    include_str!("../../../shaders/programs/programs.wgsl")
);
const TARGET: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;
/// Bytes of a picture's row: 16 pixels of 16 bytes, which is what rows of a copy must be a multiple of.
const ROW: u32 = PIXELS * 16;

/// Programs whose fragment stage has a twin for one page without mip levels.
const WITH_PLAIN: [Program; 2] = [Program::Scalar, Program::Interop];

fn entries(program: Program, is_plain: bool) -> (&'static str, &'static str) {
    match program {
        Program::Scalar if is_plain => ("vertex_scalar", "fragment_plain"),
        Program::Interop if is_plain => ("vertex_interop", "fragment_plain"),
        Program::Scalar => ("vertex_scalar", "fragment_scalar"),
        Program::Rgb => ("vertex_rgb", "fragment_rgb"),
        Program::Table => ("vertex_table", "fragment_rgb"),
        Program::Interop => ("vertex_interop", "fragment_scalar"),
        Program::Clamped => ("vertex_scalar", "fragment_clamped"),
        Program::Sh => ("vertex_sh", "fragment_sh"),
    }
}

/// A device with the textures of all cases.
struct Gpu {
    device: wgpu::Device,
    queue: wgpu::Queue,
    layouts: [wgpu::BindGroupLayout; 2],
    grey: wgpu::TextureView,
    plain: wgpu::TextureView,
    colored: Vec<wgpu::TextureView>,
    table: wgpu::TextureView,
    sampler: wgpu::Sampler,
    pipelines: BTreeMap<(Program, bool), wgpu::RenderPipeline>,
}

impl Gpu {
    fn new(textures: &Textures) -> Result<Self, Box<dyn Error>> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
            backends: wgpu::Backends::VULKAN,
            ..wgpu::InstanceDescriptor::new_without_display_handle()
        });
        let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default()))
            .map_err(|error| {
            format!("no Vulkan driver (Debian: apt-get install mesa-vulkan-drivers): {error}")
        })?;
        let info = adapter.get_info();
        eprintln!("{} ({}, {})", info.name, info.driver, info.driver_info);
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor::default()))?;
        let entry =
            |binding, visibility, ty| wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None };
        let both = wgpu::ShaderStages::VERTEX_FRAGMENT;
        let uniform = wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Uniform,
            has_dynamic_offset: false,
            min_binding_size: None,
        };
        let texture = |view_dimension| wgpu::BindingType::Texture {
            sample_type: wgpu::TextureSampleType::Float { filterable: true },
            view_dimension,
            multisampled: false,
        };
        let layout = |entries: &[wgpu::BindGroupLayoutEntry]| {
            device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: None, entries })
        };
        let shared = layout(&[
            entry(0, both, uniform),
            entry(1, both, uniform),
            entry(2, both, wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering)),
            entry(3, both, texture(wgpu::TextureViewDimension::D2)),
        ]);
        let pages = texture(wgpu::TextureViewDimension::D2Array);
        let page = texture(wgpu::TextureViewDimension::D2);
        let atlases = layout(
            &[pages, pages, pages, pages, page]
                .iter()
                .zip(0..)
                .map(|(&texture, binding)| entry(binding, wgpu::ShaderStages::FRAGMENT, texture))
                .collect::<Vec<_>>(),
        );
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            mipmap_filter: wgpu::MipmapFilterMode::Linear,
            ..Default::default()
        });
        let layouts = [shared, atlases];
        Ok(Self {
            pipelines: pipelines(&device, &layouts),
            grey: atlas(&device, &queue, &textures.grey),
            plain: upload(&device, &queue, [SIZE[0], SIZE[1] * PAGES], 1, 1, &textures.grey.levels[0]),
            colored: textures.colored.iter().map(|colored| atlas(&device, &queue, colored)).collect(),
            table: upload(&device, &queue, textures.table_size, 1, 1, &rgba(&textures.table)),
            device,
            queue,
            layouts,
            sampler,
        })
    }

    /// RGBA per pixel, row by row from the lower end of clip space; `is_plain`: of one page without mip levels.
    fn draw(&self, case: &Case, is_plain: bool) -> Result<Vec<[f32; 4]>, Box<dyn Error>> {
        let target = self.device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d { width: PIXELS, height: PIXELS, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: TARGET,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        });
        let groups = self.groups(case, is_plain);
        let buffers = self.vertices(case);
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        {
            let view = target.create_view(&wgpu::TextureViewDescriptor::default());
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                    view: &view,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations {
                        load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                        store: wgpu::StoreOp::Store,
                    },
                })],
                ..Default::default()
            });
            pass.set_pipeline(&self.pipelines[&(case.program, is_plain)]);
            for (at, group) in groups.iter().enumerate() {
                pass.set_bind_group(at as u32, group, &[]);
            }
            for (at, buffer) in buffers.iter().enumerate() {
                pass.set_vertex_buffer(at as u32, buffer.slice(..));
            }
            pass.draw(0..case.positions.len() as u32, 0..1);
        }
        let pixels = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: u64::from(ROW * PIXELS),
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        encoder.copy_texture_to_buffer(
            target.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &pixels,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(ROW),
                    rows_per_image: None,
                },
            },
            target.size(),
        );
        self.queue.submit([encoder.finish()]);
        let (sender, receiver) = mpsc::channel();
        pixels.map_async(wgpu::MapMode::Read, .., move |result| {
            // The receiver waits below; when it is gone, so is who would read the result.
            let _ = sender.send(result);
        });
        self.device.poll(wgpu::PollType::wait_indefinitely())?;
        receiver.recv()??;
        let bytes = pixels.get_mapped_range(..)?;
        // Row 0 of a WebGPU texture is the upper end of clip space.
        let numbers: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&bytes[..]);
        Ok(numbers.chunks(PIXELS as usize).rev().flatten().copied().collect())
    }

    fn groups(&self, case: &Case, is_plain: bool) -> [wgpu::BindGroup; 2] {
        let uniform = |numbers: &[f32]| {
            self.device.create_buffer_init(&BufferInitDescriptor {
                label: None,
                contents: bytemuck::cast_slice(numbers),
                usage: wgpu::BufferUsages::UNIFORM,
            })
        };
        let camera = uniform(&glam::Mat4::IDENTITY.to_cols_array());
        let [low, extent, white] = case.scale;
        let stack = [SIZE[0] as f32, (SIZE[1] * PAGES) as f32];
        let page = if is_plain { stack } else { SIZE.map(|n| n as f32) };
        let layers = uniform(
            &[[low, extent, white, 0.0].repeat(4), [stack, case.ends, page, [0.0; 2]].concat()].concat(),
        );
        let group = |layout: usize, resources: Vec<wgpu::BindingResource<'_>>| {
            let entries: Vec<_> = resources
                .into_iter()
                .enumerate()
                .map(|(binding, resource)| wgpu::BindGroupEntry { binding: binding as u32, resource })
                .collect();
            self.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: None,
                layout: &self.layouts[layout],
                entries: &entries,
            })
        };
        let view = wgpu::BindingResource::TextureView;
        let sampler = wgpu::BindingResource::Sampler(&self.sampler);
        let shared = group(
            0,
            vec![camera.as_entire_binding(), layers.as_entire_binding(), sampler, view(&self.table)],
        );
        let atlases =
            (0..4).map(|layer| if case.program.is_grey() { &self.grey } else { &self.colored[layer] });
        [shared, group(1, atlases.chain([&self.plain]).map(view).collect())]
    }

    /// A buffer for each attribute, in the order of [`attributes`].
    fn vertices(&self, case: &Case) -> Vec<wgpu::Buffer> {
        let buffer = |contents: &[u8]| {
            self.device.create_buffer_init(&BufferInitDescriptor {
                label: None,
                contents,
                usage: wgpu::BufferUsages::VERTEX,
            })
        };
        let positions: Vec<[f32; 3]> = case.positions.iter().map(|&[x, y]| [x, y, 0.0]).collect();
        let mut buffers = vec![buffer(bytemuck::cast_slice(&positions))];
        if case.program == Program::Sh {
            buffers.push(buffer(bytemuck::cast_slice(&vec![case.normal; positions.len()])));
        }
        for pairs in &case.attributes {
            buffers.push(if case.program == Program::Interop {
                buffer(bytemuck::cast_slice(pairs))
            } else {
                let codes: Vec<[u16; 2]> = pairs.iter().map(|pair| pair.map(|x| x as u16)).collect();
                buffer(bytemuck::cast_slice(&codes))
            });
        }
        buffers
    }
}

/// Format and bytes of each attribute, by location: position, a normal for harmonics, a code per layer.
fn attributes(program: Program) -> Vec<(wgpu::VertexFormat, u64)> {
    let code = match program {
        Program::Interop => (wgpu::VertexFormat::Float32x2, 8),
        _ => (wgpu::VertexFormat::Uint16x2, 4),
    };
    let mut attributes = vec![(wgpu::VertexFormat::Float32x3, 12)];
    if program == Program::Sh {
        attributes.push((wgpu::VertexFormat::Float32x3, 12));
    }
    attributes.extend(vec![code; program.layers()]);
    attributes
}

fn pipelines(
    device: &wgpu::Device,
    layouts: &[wgpu::BindGroupLayout; 2],
) -> BTreeMap<(Program, bool), wgpu::RenderPipeline> {
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(WGSL.into()),
    });
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: None,
        bind_group_layouts: &[Some(&layouts[0]), Some(&layouts[1])],
        immediate_size: 0,
    });
    let pipeline = |program, is_plain| {
        let (vertex, fragment) = entries(program, is_plain);
        let attributes: Vec<_> = (0..)
            .zip(attributes(program))
            .map(|(shader_location, (format, bytes))| {
                ([wgpu::VertexAttribute { format, offset: 0, shader_location }], bytes)
            })
            .collect();
        let buffers: Vec<_> = attributes
            .iter()
            .map(|(attributes, bytes)| {
                Some(wgpu::VertexBufferLayout {
                    array_stride: *bytes,
                    step_mode: wgpu::VertexStepMode::Vertex,
                    attributes,
                })
            })
            .collect();
        device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: None,
            layout: Some(&layout),
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some(vertex),
                compilation_options: Default::default(),
                buffers: &buffers,
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: None,
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some(fragment),
                compilation_options: Default::default(),
                targets: &[Some(TARGET.into())],
            }),
            multiview_mask: None,
            cache: None,
        })
    };
    let plain = WITH_PLAIN.map(|program| (program, true));
    let all = Program::ALL.map(|program| (program, false)).into_iter().chain(plain);
    all.map(|(program, is_plain)| ((program, is_plain), pipeline(program, is_plain))).collect()
}

fn atlas(device: &wgpu::Device, queue: &wgpu::Queue, atlas: &Atlas) -> wgpu::TextureView {
    let levels = atlas.levels.concat();
    let texels = if atlas.channels == 1 { levels } else { rgba(&levels) };
    upload(device, queue, SIZE, PAGES, atlas.levels.len() as u32, &texels)
}

/// RGB with a fourth number, for GPUs have no textures of three.
fn rgba(rgb: &[u8]) -> Vec<u8> {
    rgb.chunks(3).flat_map(|rgb| [rgb[0], rgb[1], rgb[2], 255]).collect()
}

/// A texture of one or four channels, level by level; with pages it is an array.
fn upload(
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    [width, height]: [u32; 2],
    pages: u32,
    levels: u32,
    texels: &[u8],
) -> wgpu::TextureView {
    let count = pages * (0..levels).map(|level| (width >> level) * (height >> level)).sum::<u32>();
    let is_grey = texels.len() as u32 == count;
    let descriptor = wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width, height, depth_or_array_layers: pages },
        mip_level_count: levels,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: if is_grey { wgpu::TextureFormat::R8Unorm } else { wgpu::TextureFormat::Rgba8Unorm },
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    };
    let texture = device.create_texture_with_data(queue, &descriptor, TextureDataOrder::MipMajor, texels);
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}

#[test]
fn vulkan_shows_what_the_cpu_twin_says() -> Result<(), Box<dyn Error>> {
    let (textures, cases) = cases();
    let gpu = Gpu::new(&textures)?;
    let mut results: BTreeMap<_, (f32, usize)> = BTreeMap::new();
    let mut compare = |case: &Case, is_plain| -> Result<(), Box<dyn Error>> {
        let expected = if is_plain { &case.plain } else { &case.expected };
        let (difference, compared) = case.difference(&gpu.draw(case, is_plain)?, expected);
        let result = results.entry((case.program, is_plain, case.scale[2] > 0.0)).or_default();
        *result = (result.0.max(difference), result.1 + compared);
        Ok(())
    };
    for case in &cases {
        compare(case, false)?;
        if WITH_PLAIN.contains(&case.program) {
            compare(case, true)?;
        }
    }
    for ((program, is_plain, is_log), (largest, compared)) in &results {
        let [plain, curve] =
            [["", ", plain"][usize::from(*is_plain)], ["linear", "log"][usize::from(*is_log)]];
        eprintln!("{program:?}{plain}, {curve}: off by {largest:.1e} at most, of {compared} pixels");
    }
    assert_eq!(results.len(), 2 * (Program::ALL.len() + WITH_PLAIN.len()) - 1);
    for ((program, ..), (largest, compared)) in results {
        assert!(compared > 1500, "{program:?}: only {compared} pixels");
        assert!(largest <= BOUND, "{program:?}: off by {largest}");
    }
    Ok(())
}
