//! Mistakes inside `model!` are errors of rustc at the tokens that the user wrote.

#[test]
fn mistakes_stand_at_their_tokens() {
    trybuild::TestCases::new().compile_fail("ui/*.rs");
}
