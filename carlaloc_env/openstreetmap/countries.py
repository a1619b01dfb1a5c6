"""Rules of countries: limits where nothing is signed, and the side one drives on."""

from dataclasses import dataclass

_MPH = 1.609344


@dataclass(frozen=True, slots=True)
class Country:
    """Rules of one country."""

    code: str
    """ISO 3166."""
    town_kmh: float
    """Limit in towns where no sign stands [km/h]."""
    country_kmh: float
    """Limit outside towns [km/h]."""
    motorway_kmh: float
    """Limit on motorways [km/h]."""
    left: bool = False
    """Whether one drives on the left."""


# West, south, east, north [deg]; the first box that holds the place decides, so small countries stand first.
_BOXES: tuple[tuple[Country, tuple[tuple[float, float, float, float], ...]], ...] = (
    (Country("IE", 50, 80, 120, True), ((-10.7, 51.3, -6.2, 54.4), (-10.7, 54.4, -7.5, 55.5))),
    (
        Country("GB", 30 * _MPH, 60 * _MPH, 70 * _MPH, True),
        ((-8.3, 49.8, -5.6, 61.0), (-5.7, 50.0, 1.8, 61.0), (-5.7, 49.8, -1.0, 50.7)),
    ),
    (Country("MT", 50, 80, 80, True), ((14.1, 35.7, 14.7, 36.1),)),
    (Country("CY", 50, 80, 100, True), ((32.2, 34.5, 34.7, 35.8),)),
    (Country("HK", 50, 70, 110, True), ((113.8, 22.1, 114.5, 22.57),)),
    (Country("SG", 50, 70, 90, True), ((103.6, 1.15, 104.1, 1.48),)),
    (Country("TW", 50, 60, 110), ((119.9, 21.8, 122.1, 25.4),)),
    (Country("KR", 50, 80, 100), ((125.8, 33.0, 129.0, 38.7),)),
    (Country("JP", 40, 60, 100, True), ((129.0, 30.0, 146.0, 45.6), (122.9, 24.0, 131.5, 30.0))),
    (Country("LK", 50, 70, 100, True), ((79.5, 5.8, 82.0, 9.9),)),
    (Country("BD", 40, 80, 80, True), ((88.0, 20.6, 92.4, 26.5),)),
    (Country("NP", 40, 80, 80, True), ((80.0, 26.4, 88.2, 30.5),)),
    (Country("PK", 50, 80, 120, True), ((60.9, 23.6, 74.5, 36.9),)),
    (Country("IN", 50, 80, 120, True), ((68.0, 6.5, 92.0, 33.0), (92.0, 21.9, 97.4, 29.5))),
    (Country("TH", 50, 90, 120, True), ((97.3, 5.6, 102.2, 20.5), (102.2, 12.0, 105.0, 17.8))),
    (Country("MY", 50, 90, 110, True), ((99.6, 1.2, 104.3, 6.7), (109.5, 0.9, 119.3, 7.4))),
    (Country("ID", 50, 80, 100, True), ((95.0, -11.0, 141.0, 6.0),)),
    (Country("AU", 50, 100, 110, True), ((112.9, -43.7, 153.7, -10.0),)),
    (Country("NZ", 50, 100, 100, True), ((166.0, -47.4, 179.0, -34.3),)),
    (Country("ZA", 60, 100, 120, True), ((16.4, -34.9, 32.9, -22.1),)),
    (Country("KE", 50, 100, 110, True), ((33.9, -4.7, 41.9, 5.0),)),
    (Country("JM", 50, 80, 110, True), ((-78.4, 17.7, -76.1, 18.6),)),
    (Country("FI", 50, 80, 120), ((20.5, 59.7, 31.6, 70.1),)),
    (Country("SE", 50, 70, 110), ((11.0, 55.3, 24.2, 69.1),)),
    (Country("NO", 50, 80, 100), ((4.5, 57.9, 11.0, 71.2), (11.0, 61.0, 31.1, 71.2))),
    (Country("DK", 50, 80, 130), ((8.0, 54.5, 12.8, 57.8),)),
    (Country("CH", 50, 80, 120), ((5.9, 45.8, 9.5, 47.6),)),
    (Country("AT", 50, 100, 130), ((9.5, 46.4, 13.0, 47.6), (13.0, 46.4, 17.1, 48.8))),
    (Country("CZ", 50, 90, 130), ((12.5, 48.8, 18.9, 50.8),)),
    (Country("NL", 50, 80, 100), ((3.3, 51.2, 7.1, 53.6),)),
    (Country("BE", 50, 70, 120), ((2.5, 49.5, 6.2, 51.4),)),
    (Country("DE", 50, 100, 130), ((5.9, 47.3, 15.1, 55.1),)),
    (Country("PL", 50, 90, 140), ((14.1, 49.0, 24.2, 54.9),)),
    (Country("FR", 50, 80, 130), ((-4.9, 42.3, 8.2, 51.1), (8.5, 41.3, 9.6, 43.1))),
    (Country("ES", 50, 90, 120), ((-9.3, 36.0, 3.3, 43.8),)),
    (Country("PT", 50, 90, 120), ((-9.6, 36.9, -6.2, 42.2),)),
    (Country("IT", 50, 90, 130), ((6.6, 36.6, 18.6, 47.1),)),
    (Country("CA", 50, 80, 100), ((-141.0, 49.0, -52.6, 70.0), (-79.8, 43.6, -66.9, 49.0))),
    (
        Country("US", 30 * _MPH, 55 * _MPH, 65 * _MPH),
        ((-125.0, 24.5, -66.9, 49.0), (-168.0, 54.0, -130.0, 71.4)),
    ),
)  # fmt: skip
_ELSEWHERE = Country("", 50, 80, 110)


def country_of(longitude_deg: float, latitude_deg: float) -> Country:
    """Rules of a place, by coarse boxes; the commonest ones where no box holds it."""
    for country, boxes in _BOXES:
        if any(w <= longitude_deg <= e and s <= latitude_deg <= n for w, s, e, n in boxes):
            return country
    return _ELSEWHERE
