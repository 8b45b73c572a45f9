//! Parts that an animation moves: light that is baked where they stand is wrong wherever else they go, and so is their
//! shadow on what stands still.

use lightkiln_scene::Scene;
use serde::{Deserialize, Serialize};

/// What becomes of parts that an animation moves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "bool", into = "bool")]
pub enum Moving {
    /// They are left out, unless they are more than half of the area that would get light.
    #[default]
    Auto,
    /// They are baked where they stand.
    Keep,
    /// They get no light and stand in nobody's way.
    LeaveOut,
}

impl From<bool> for Moving {
    fn from(left_out: bool) -> Self {
        if left_out { Self::LeaveOut } else { Self::Keep }
    }
}

impl From<Moving> for bool {
    fn from(moving: Moving) -> Self {
        moving == Moving::LeaveOut
    }
}

impl Moving {
    pub(crate) fn kept() -> Self {
        Self::Keep
    }

    pub(crate) fn is_not_left_out(&self) -> bool {
        *self != Self::LeaveOut
    }
}

/// The share of the area from which on moving parts are the scene itself, as in the exploded view of an assembly.
const MOST: f64 = 0.5;

/// Parts that a remark names.
const NAMED: usize = 3;

/// The parts that an animation moves, and what becomes of them.
#[derive(Clone, Debug)]
pub struct MovingParts {
    /// Per part of the scene: it moves.
    pub moves: Vec<bool>,
    /// Whether those that move are left out.
    pub left_out: bool,
    /// The share that they have of the area that would get light, 0 to 1.
    pub share: f64,
    choice: Moving,
}

impl MovingParts {
    /// - `receives`: per part, whether it was chosen to get light
    pub fn new(scene: &Scene, receives: &[bool], choice: Moving) -> Self {
        let moves = scene.moving_parts();
        let (mut moving, mut total) = (0.0, 0.0);
        for (part, moves) in moves.iter().enumerate() {
            if receives[part] && scene.roles(part).receives {
                let area = scene.parts[part].area();
                total += area;
                moving += if *moves { area } else { 0.0 };
            }
        }
        let share = if total > 0.0 { moving / total } else { 0.0 };
        let left_out = match choice {
            Moving::Auto => share <= MOST && moves.contains(&true),
            Moving::Keep => false,
            Moving::LeaveOut => true,
        };
        Self { moves, left_out, share, choice }
    }

    /// What is worth a word: how many there are, the first of them by name, and how to have it otherwise.
    pub fn remark(&self, scene: &Scene) -> Option<String> {
        let mut names: Vec<String> =
            (0..self.moves.len()).filter(|&p| self.moves[p]).map(|p| scene.part_name(p)).collect();
        // Parts of one node follow each other.
        names.dedup();
        if names.is_empty() {
            return None;
        }
        let rest = names.len().saturating_sub(NAMED);
        let more = if rest > 0 { format!(" and {rest} more") } else { String::new() };
        let count = if names.len() == 1 { "1 node is".into() } else { format!("{} nodes are", names.len()) };
        let moved = format!(
            "{count} moved by animations ({}{more}; {:.0} % of the area)",
            names[..names.len().min(NAMED)].join(", "),
            self.share * 100.0
        );
        let stand = "baked where they stand; --moving leave-out leaves them out";
        Some(match (self.left_out, self.choice) {
            (true, _) => format!(
                "{moved}: they get no light and stand in nobody's way; --moving keep bakes them where they stand"
            ),
            (false, Moving::Keep) => format!("{moved}: they are {stand}"),
            (false, _) => format!("{moved}: as that is more than half of it, they are {stand}"),
        })
    }
}
