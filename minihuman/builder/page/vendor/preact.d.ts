// The types of what the page uses of preact.js, which has none of its own.
export type VNode = { type: unknown; props: unknown };
export type Child = VNode | string | number | boolean | null | undefined | Child[];
export function html(strings: TemplateStringsArray, ...values: unknown[]): VNode;
export function render(tree: VNode, parent: Element): void;
export function useState<T>(initial: T | (() => T)): [T, (next: T | ((previous: T) => T)) => void];
export function useEffect(effect: () => void | (() => void), inputs?: readonly unknown[]): void;
export function useLayoutEffect(effect: () => void | (() => void), inputs?: readonly unknown[]): void;
export function useRef<T>(initial: T): { current: T };
export function useMemo<T>(build: () => T, inputs: readonly unknown[]): T;
export function useCallback<T extends (...parameters: never[]) => unknown>(callback: T, inputs: readonly unknown[]): T;
