// Writes only what differs: told the same again, a browser lays the page out and draws it anew, which
// ten times a second keeps a machine without a GPU busy.
export function put(element, properties) {
  for (const [name, value] of Object.entries(properties)) if (element[name] !== value) element[name] = value;
}
