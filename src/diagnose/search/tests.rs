//! Whether effects that are hidden in simulated runs are found, and nothing where there is none.
