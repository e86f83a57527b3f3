//! The few letters that pictures need, three dots wide and five high.

/// Dots along a letter.
pub(super) const WIDTH: i64 = 3;

/// The dots of a letter: x to the right, y down. A row's three dots are an octal digit.
pub(super) fn dots_of(character: char) -> impl Iterator<Item = (i64, i64)> {
    let rows: [u8; 5] = match character {
        '0' => [7, 5, 5, 5, 7],
        '1' => [2, 6, 2, 2, 7],
        '2' => [7, 1, 7, 4, 7],
        '3' => [7, 1, 3, 1, 7],
        '4' => [5, 5, 7, 1, 1],
        '5' => [7, 4, 7, 1, 7],
        '6' => [7, 4, 7, 5, 7],
        '7' => [7, 1, 1, 2, 2],
        '8' => [7, 5, 7, 5, 7],
        '9' => [7, 5, 7, 1, 7],
        '.' => [0, 0, 0, 0, 2],
        '-' => [0, 0, 7, 0, 0],
        '/' => [1, 1, 2, 4, 4],
        'm' => [0, 7, 7, 5, 5],
        's' => [0, 3, 6, 3, 6],
        _ => [0; 5],
    };
    (0..).zip(rows).flat_map(|(y, row)| {
        (0..WIDTH)
            .filter(move |x| row & (4 >> x) != 0)
            .map(move |x| (x, y))
    })
}
