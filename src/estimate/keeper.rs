//! Where the state of a long estimation is kept, so that it can be interrupted at any moment and go on.

/// Keeps byte strings under names. What was kept last is found again, whole, whenever the program ended: an implementation
/// must never lose the state before when it is interrupted while keeping the next (see the room `store`).
pub trait Keeper: Send + Sync {
    /// Keeps `state` under `name`, in place of what was kept there.
    ///
    /// # Errors
    /// A sentence that names the place and the reason; what was kept before is still there.
    fn keep(&self, name: &str, state: &[u8]) -> Result<(), String>;

    /// What was kept under `name` last; none when nothing was.
    ///
    /// # Errors
    /// A sentence that names the place and the reason, when something was kept that cannot be read.
    fn find(&self, name: &str) -> Result<Option<Vec<u8>>, String>;
}
