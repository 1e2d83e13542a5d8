//! The road from a problem to its estimate.
//!
//! **In** a [`Problem`](crate::Problem), options, [`Work`](crate::Work). **Out** an [`Estimate`](crate::Estimate), whatever became of
//! the iteration. **Start** at [`solve`]: smoothness of tables, iteration, uncertainty; what the data do not determine is held.

pub(crate) mod estimate;
pub(crate) mod smoothness;
pub(crate) mod solve;
pub(crate) mod table_nodes;
