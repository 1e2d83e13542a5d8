//! Known parameters found again from simulated records; refusals; structures.
