"""Files of scenes whose bodies are sheets, that are built and run in no time."""

BOX = """
bodies:
  - shape: {kind: box, size: [30 cm, 20 cm, 15 cm]}
    sheet:
      layers:
        - {material: {name: steel, emissivity: 0.9}, thickness: 1 mm}
        - {material: mineral_wool, thickness: 1 cm}
      pitch: 5 cm
      cells: 2
    interior: {temperature: 40 degC, heat_transfer_coefficient: 4 W/(m^2 K)}
    coatings: [{emissivity: 0.8, on: {face: front}}]
    temperature: 20 degC
terms:
  - {kind: sun, direction: [0.5, 0.2, -1], irradiance: 800}
  - {kind: surroundings, temperature: 5 degC}
  - {kind: convection, heat_transfer_coefficient: 10, temperature: 20 degC}
time: {end: 10 min, save_at: [1 min, 3 min, 5 min, 10 min]}
camera: {width: 40, height: 30}
"""
PLATE = """
bodies:
  - shape: {kind: rectangle, width: 40 cm, length: 20 cm}
    sheet: {layers: [{material: steel, thickness: 2 mm}], pitch: 4 cm}
    temperature: 20 degC
terms:
  - {kind: heat_flux, heat_flux: 3 kW/m^2,
     on: {region: {lower: [-1, -1, -1], upper: [0, 1, 1]}}}
  - {kind: convection, heat_transfer_coefficient: 20, temperature: 20 degC}
time: {end: 10 min, save_at: [5 min, 10 min]}
camera: {width: 40, height: 30}
"""
