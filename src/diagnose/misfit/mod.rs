//! What is wrong before anything is explained.
