//! Work on all threads. What hands it to the threads is compiled once, and not for each closure anew.

use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};

/// What becomes of each item, in their order.
pub fn map<A: Send, B: Send>(items: impl IntoIterator<Item = A>, of: impl Fn(A) -> B + Sync) -> Vec<B> {
    let places: Vec<Mutex<(Option<A>, Option<B>)>> =
        items.into_iter().map(|item| Mutex::new((Some(item), None))).collect();
    each_place(places.len(), &|k| {
        let mut place = places[k].lock().unwrap_or_else(PoisonError::into_inner);
        place.1 = place.0.take().map(&of);
    });
    places.into_iter().filter_map(|place| place.into_inner().unwrap_or_else(PoisonError::into_inner).1).collect()
}

/// What becomes of each item that something becomes of, in their order.
pub fn filter_map<A: Send, B: Send>(items: impl IntoIterator<Item = A>, of: impl Fn(A) -> Option<B> + Sync) -> Vec<B> {
    map(items, of).into_iter().flatten().collect()
}

/// Does something with each item.
pub fn each<A: Send>(items: impl IntoIterator<Item = A>, act: impl Fn(A) + Sync) {
    map(items, act);
}

fn each_place(count: usize, act: &(dyn Fn(usize) + Sync)) {
    (0..count).into_par_iter().for_each(act);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_stand_in_the_order_of_the_items() {
        let numbers: Vec<usize> = (0..1000).collect();
        assert_eq!(map(&numbers, |n| 2 * n), numbers.iter().map(|n| 2 * n).collect::<Vec<_>>());
        let mut own = numbers.clone();
        each(&mut own, |n| *n += 1);
        assert_eq!(own[999], 1000);
        assert!(map(Vec::<String>::new(), |text| text).is_empty());
    }
}
