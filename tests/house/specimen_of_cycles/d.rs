//! Imports nothing: // use crate::a;

#[cfg(test)]
mod tests {
    use crate::a::Alpha;
}
