//! The project's own scenes, made by code: small ones for tests, a seat and a car of any size for measurements.
//!
//! Every scene is a function of its name and size and comes out as the same bytes each time, in metres (but for
//! `millimetres`, which is there to be wrong), y up.
//!
//! | module | what |
//! |---|---|
//! | [`model`] | meshes, materials and nodes of a scene |
//! | [`shapes`] | patches, panels with hems, lathes, tubes, boxes, cushions |
//! | [`small`] | scenes of a few triangles, each for one feature |
//! | [`lit`] | scenes with light of their own |
//! | [`faults`] | one for each way in which light goes wrong |
//! | [`house`] | a cottage in its garden |
//! | [`seat`] | an upholstered car seat |
//! | [`car`] | a car of many panels |
//! | [`picture`] | an image on a flat mesh |
//! | [`glb`] | the container and its JSON |

pub mod car;
pub mod faults;
pub mod glb;
pub mod house;
pub mod lit;
pub mod model;
pub mod picture;
pub mod seat;
pub mod shapes;
pub mod small;
#[cfg(test)]
mod tests;

use model::Assembly;

/// Why a scene cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum PropsError {
    /// There is no scene of that name.
    #[error("no scene is called {name:?}")]
    Unknown {
        /// The name asked for.
        name: String,
    },
    /// The scene cannot be made in that size.
    #[error("scene {name} has sizes {smallest}..={largest}, not {size}")]
    Size {
        /// The scene.
        name: &'static str,
        /// The size asked for.
        size: usize,
        /// The smallest one.
        smallest: usize,
        /// The largest one.
        largest: usize,
    },
    /// The scene's buffer is larger than a GLB can hold.
    #[error("scene needs {bytes} bytes, a glb holds {limit}")]
    TooLarge {
        /// Bytes needed.
        bytes: u64,
        /// Bytes possible.
        limit: u64,
    },
    /// A texture could not be encoded.
    #[error("texture cannot be encoded")]
    Texture(#[from] png::EncodingError),
    /// The JSON could not be written.
    #[error("scene description cannot be written")]
    Json(#[from] serde_json::Error),
}

/// Which diagonal splits each square of `half_box`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Diagonal {
    /// The one from the corner that the three squares share.
    #[default]
    Corner,
    /// The other one.
    Other,
}

/// A scene that can be made.
#[derive(Clone, Copy, Debug)]
pub struct Recipe {
    /// What it is called.
    pub name: &'static str,
    /// What it shows.
    pub about: &'static str,
    /// What its size counts.
    pub size_is: &'static str,
    /// The size if none is given.
    pub default_size: usize,
    /// Smallest and largest size; both 0 if it has only one.
    pub sizes: (usize, usize),
    make: fn(usize, Diagonal) -> Result<Assembly, PropsError>,
}

/// All scenes.
pub const RECIPES: &[Recipe] = &[
    Recipe {
        name: "half_box",
        about: "three unit squares meeting in a corner, normals into the corner: 12 vertices, 6 triangles",
        size_is: "",
        default_size: 0,
        sizes: (0, 0),
        make: |_, diagonal| Ok(small::half_box(diagonal)),
    },
    Recipe {
        name: "cornell_box",
        about: "five walls, two boxes and a light",
        size_is: "squares along a wall",
        default_size: 16,
        sizes: (1, 512),
        make: |size, _| Ok(small::cornell_box(size)),
    },
    Recipe {
        name: "l_shape",
        about: "two perpendicular unit squares meeting in an edge",
        size_is: "squares along an edge: 16, 32, 64",
        default_size: 32,
        sizes: (1, 2048),
        make: |size, _| Ok(small::l_shape(size)),
    },
    Recipe {
        name: "column",
        about: "a column on a plane, 200 vertices and 246 triangles as in Krivanek 2004, figure 1",
        size_is: "",
        default_size: 0,
        sizes: (0, 0),
        make: |_, _| Ok(small::column()),
    },
    Recipe {
        name: "instances",
        about: "one mesh in five nodes: moved, turned, mirrored, scaled unevenly",
        size_is: "",
        default_size: 0,
        sizes: (0, 0),
        make: |_, _| Ok(small::instances()),
    },
    Recipe {
        name: "fence",
        about: "wire mesh as cards with an alpha mask, between posts, on the ground",
        size_is: "",
        default_size: 0,
        sizes: (0, 0),
        make: |_, _| small::fence(),
    },
    Recipe {
        name: "thin_wall",
        about: "a wall four millimetres thick with a shelf on one side, on the ground",
        size_is: "squares per metre",
        default_size: 16,
        sizes: (2, 1024),
        make: |size, _| Ok(small::thin_wall(size)),
    },
    Recipe {
        name: "contact",
        about: "a cube standing on a plane, cubes running into each other",
        size_is: "",
        default_size: 0,
        sizes: (0, 0),
        make: |_, _| Ok(small::contact(1.0)),
    },
    Recipe {
        name: "millimetres",
        about: "the scene contact in millimetres instead of metres",
        size_is: "",
        default_size: 0,
        sizes: (0, 0),
        make: |_, _| Ok(small::contact(1000.0)),
    },
    Recipe {
        name: "picture",
        about: "a flat image on triangles that follow it, as Kavan 2011, figure 8",
        size_is: "triangles",
        default_size: 2000,
        sizes: (2, 100_000),
        make: |size, _| picture::picture(size),
    },
    Recipe {
        name: "seat",
        about: "an upholstered car seat: quilted cushions, bolsters, piping, headrest, rails",
        size_is: "triangles",
        default_size: 160_000,
        sizes: (40_000, 4_000_000),
        make: |size, _| Ok(seat::seat(size)),
    },
    Recipe {
        name: "car",
        about: "a car of some hundred parts with gaps between its panels, glass, wheels, seats, underbody",
        size_is: "triangles",
        default_size: 400_000,
        sizes: (100_000, 13_600_000),
        make: |size, _| Ok(car::car(size)),
    },
    Recipe {
        name: "house",
        about: "a cottage in a garden: trees, ferns, grass, fence, stones",
        size_is: "triangles",
        default_size: 199_000,
        sizes: (80_000, 4_000_000),
        make: |size, _| Ok(house::house(size)),
    },
    Recipe {
        name: "car_studio",
        about: "the car on a floor under a sun",
        size_is: "triangles",
        default_size: 400_000,
        sizes: (105_000, 13_600_000),
        make: |size, _| Ok(lit::car_studio(size)),
    },
    Recipe {
        name: "seat_room",
        about: "the seat in a room with one bright panel",
        size_is: "triangles",
        default_size: 160_000,
        sizes: (47_000, 4_000_000),
        make: |size, _| Ok(lit::seat_room(size)),
    },
    Recipe {
        name: "room",
        about: "that room without the seat",
        size_is: "squares along a wall",
        default_size: 24,
        sizes: (1, 512),
        make: |size, _| Ok(lit::room(size)),
    },
    Recipe {
        name: "cornell",
        about: "the Cornell box as it was measured, its lamp in cd/m2",
        size_is: "squares along a wall",
        default_size: 16,
        sizes: (1, 512),
        make: |size, _| Ok(lit::cornell(size)),
    },
    Recipe {
        name: "furnace",
        about: "a closed room that glows: the same light everywhere",
        size_is: "squares along a wall",
        default_size: 12,
        sizes: (1, 512),
        make: |size, _| Ok(lit::furnace(size)),
    },
    Recipe {
        name: "disk_light",
        about: "a glowing disk above a floor",
        size_is: "squares along the floor",
        default_size: 32,
        sizes: (1, 2048),
        make: |size, _| Ok(lit::disk_light(size)),
    },
    Recipe {
        name: "window",
        about: "a furnished room with one glazed window, and a sun",
        size_is: "squares per metre",
        default_size: 10,
        sizes: (1, 256),
        make: |size, _| Ok(lit::window(size)),
    },
    Recipe {
        name: "leaks",
        about: "thin walls, contact, coincident faces, open and mirrored shells under a sun",
        size_is: "squares per metre",
        default_size: 8,
        sizes: (1, 256),
        make: |size, _| Ok(lit::leaks(size)),
    },
    Recipe {
        name: "punctual",
        about: "a sun, a point and a spot over a box and a ball",
        size_is: "squares along the floor",
        default_size: 32,
        sizes: (1, 2048),
        make: |size, _| Ok(lit::punctual(size)),
    },
    Recipe {
        name: "fault_back_faces",
        about: "a double-sided ball with its fronts inside, beside one as it should be",
        size_is: "",
        default_size: 0,
        sizes: (0, 0),
        make: |_, _| Ok(faults::back_faces()),
    },
    Recipe {
        name: "fault_inside",
        about: "a leg sunk into a slab, one of whose vertices lies inside it",
        size_is: "",
        default_size: 0,
        sizes: (0, 0),
        make: |_, _| Ok(faults::inside()),
    },
    Recipe {
        name: "fault_terminator",
        about: "smooth balls of few triangles under a sun from the side",
        size_is: "",
        default_size: 0,
        sizes: (0, 0),
        make: |_, _| Ok(faults::terminator()),
    },
    Recipe {
        name: "fault_contact",
        about: "cubes that stand on a floor, a hair above it and a hair below",
        size_is: "",
        default_size: 0,
        sizes: (0, 0),
        make: |_, _| Ok(faults::contact()),
    },
    Recipe {
        name: "fault_thin_wall",
        about: "a wall of two millimetres on a floor that runs through below it",
        size_is: "",
        default_size: 0,
        sizes: (0, 0),
        make: |_, _| Ok(faults::thin_wall()),
    },
    Recipe {
        name: "fault_coincident",
        about: "faces in one place: in a floor, of boxes that run through each other, back to back",
        size_is: "",
        default_size: 0,
        sizes: (0, 0),
        make: |_, _| Ok(faults::coincident()),
    },
    Recipe {
        name: "fault_mirrored",
        about: "a part and its image in a node that mirrors",
        size_is: "",
        default_size: 0,
        sizes: (0, 0),
        make: |_, _| Ok(faults::mirrored()),
    },
    Recipe {
        name: "fault_open_shell",
        about: "half balls of one sheet, with fronts inside and outside",
        size_is: "",
        default_size: 0,
        sizes: (0, 0),
        make: |_, _| Ok(faults::open_shell()),
    },
];

/// The recipe of a scene.
///
/// # Errors
/// [`PropsError::Unknown`].
pub fn recipe(name: &str) -> Result<&'static Recipe, PropsError> {
    RECIPES.iter().find(|r| r.name == name).ok_or_else(|| PropsError::Unknown { name: name.to_owned() })
}

impl Recipe {
    /// Makes the scene. No size is the default one.
    ///
    /// # Errors
    /// [`PropsError::Size`] for a size that it does not have.
    pub fn assembly(&self, size: Option<usize>, diagonal: Diagonal) -> Result<Assembly, PropsError> {
        let size = size.unwrap_or(self.default_size);
        let (smallest, largest) = self.sizes;
        if size < smallest || size > largest {
            return Err(PropsError::Size { name: self.name, size, smallest, largest });
        }
        (self.make)(size, diagonal)
    }
}

/// A scene as the bytes of a .glb file.
///
/// - `size`: what it counts depends on the scene, see [`RECIPES`]; for `seat` and `car` the number of triangles,
///   met to a few percent
///
/// # Errors
/// [`PropsError`] for unknown names and sizes that the scene does not have.
pub fn scene(name: &str, size: Option<usize>) -> Result<Vec<u8>, PropsError> {
    scene_with(name, size, Diagonal::default())
}

/// [`scene`], with the diagonal of `half_box`.
///
/// # Errors
/// As [`scene`].
pub fn scene_with(name: &str, size: Option<usize>, diagonal: Diagonal) -> Result<Vec<u8>, PropsError> {
    glb::write(&recipe(name)?.assembly(size, diagonal)?)
}
